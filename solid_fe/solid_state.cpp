// What a later step of the solid depends on, to and from archives.
#include "solid_fe/solid.hpp"

#include <numeric>

namespace undine::solid
{

namespace
{

/// History of the elements of a block, element after element, `row` numbers each.
template <class Element>
std::vector<double> rows_of(const ReferenceBlock<Element>& block, const std::vector<Lanes>& history,
                            std::size_t row)
{
  std::vector<double> rows;
  rows.reserve(row * block.nodes.size());
  for (index_t e = 0; e < block.size(); ++e)
  {
    const auto [p, lane] = block.place(e);
    for (std::size_t j = 0; j < row; ++j)
      rows.push_back(history[static_cast<std::size_t>(p) * row + j][lane]);
  }
  return rows;
}

/// The same in packs; the places that are left at the end of a part repeat its last element.
template <class Element>
std::vector<Lanes> packs_of(const ReferenceBlock<Element>& block, const std::vector<double>& rows,
                            std::size_t row)
{
  std::vector<Lanes> history(static_cast<std::size_t>(block.n_packs()) * row);
  for (index_t p = 0; p < block.n_packs(); ++p)
  {
    const auto [first, count] = block.elements_of(p);
    for (int k = 0; k < Lanes::size; ++k)
      for (std::size_t j = 0; j < row; ++j)
        history[static_cast<std::size_t>(p) * row + j].set(
            k, rows[static_cast<std::size_t>(first + std::min(k, count - 1)) * row + j]);
  }
  return history;
}

} // namespace

/// The part of this rank of what the whole body k remembers.
template <int dim>
void Solid<dim>::take_state(std::size_t k, const BodyState<dim>& all)
{
  const auto& whole = whole_[k];
  auto& state = bodies_[k].state;
  state.nodal_volume = all.nodal_volume;
  state.nodal_field = all.nodal_field;
  state.element_tau.clear();
  for (const index_t e : whole.held)
    if (!all.element_tau.empty())
      state.element_tau.push_back(all.element_tau[static_cast<std::size_t>(e)]);
  const auto rows =
      std::visit([&](const auto& block) { return rows_of(block, all.history, whole.row); }, whole.block);
  std::vector<double> mine;
  for (const index_t e : whole.held)
    mine.insert(mine.end(),
                rows.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(e) * whole.row),
                rows.begin() + static_cast<std::ptrdiff_t>((static_cast<std::size_t>(e) + 1) * whole.row));
  state.history =
      std::visit([&](const auto& block) { return packs_of(block, mine, whole.row); }, bodies_[k].block);
}

/// What body k remembers; in a file element after element, whoever holds them.
template <int dim>
void Solid<dim>::archive_body(StateArchive& archive, std::size_t k, std::span<const RowRun> own)
{
  const std::string name = "body_" + std::to_string(k);
  auto& state = bodies_[k].state;
  if (archive.in_memory())
    return archive(name, state);
  const std::vector<index_t> places =
      archive.reading() && !whole_.empty() ? whole_[k].held : counted_elements(k);
  const auto n = std::visit([](const auto& block) { return block.nodes.size(); }, whole_block(k));
  std::visit(
      [&](const auto& block)
      {
        const auto packs = static_cast<std::size_t>(block.n_packs());
        const std::size_t row = !whole_.empty() ? whole_[k].row
                                : packs > 0     ? state.history.size() / packs
                                                : 0;
        auto rows = rows_of(block, state.history, row);
        archive.part(name + "/history", rows, n * row, runs_of(places, row));
        if (archive.reading())
          state.history = packs_of(block, rows, row);
      },
      bodies_[k].block);
  archive.rows(name + "/nodal_volume", state.nodal_volume, own);
  archive.rows(name + "/nodal_field", state.nodal_field, own);
  if (!state.nodal_volume.empty())
    archive.part(name + "/element_tau", state.element_tau, n, runs_of(places));
}

template <int dim>
template <class Driven, class Mine>
void Solid<dim>::archive_driven(StateArchive& archive, const std::string& name, std::vector<Driven>& list,
                                Mine&& mine)
{
  std::vector<std::array<double, 3>> rows;
  std::vector<index_t> places;
  for (const Driven& driven : list)
  {
    places.push_back(archive.reading() || mine(driven) ? static_cast<index_t>(rows.size()) : -1);
    rows.push_back({driven.reaction, driven.v_step, driven.v_end});
  }
  archive.part(name, rows, list.size(), runs_of(places));
  for (std::size_t k = 0; k < list.size(); ++k)
  {
    list[k].reaction = rows[k][0];
    list[k].v_step = rows[k][1];
    list[k].v_end = rows[k][2];
  }
}

template <int dim>
void Solid<dim>::for_each_state(StateArchive& archive)
{
  const auto own = share_.own_rows(nodes_.X.size());
  const auto rows = [&](const char* name, auto& field) // of all nodes, or of the wet ones
  { archive.rows(name, field, field.size() == nodes_.X.size() ? own : share_.own_rows(field.size())); };
  nodes_.for_each_field(rows);
  for (std::size_t k = 0; k < bodies_.size(); ++k)
    archive_body(archive, k, own);
  rows("F_int", F_int_);
  rows("F_ext", F_ext_);
  archive_driven(archive, "driven", driven_, [this](const auto& d) { return share_.owns(d.node); });
  archive("loads_are_full", loads_are_full_);
  rows("F_viscous", F_viscous_);
  rows("F_viscous_old", F_viscous_old_);
  archive("rigid", rigid_);
  archive("contact", contact_);
  rows("F_contact", F_contact_);
  rows("F_contact_old", F_contact_old_);
  rows("F_formula", F_formula_);
  rows("F_formula_old", F_formula_old_);
  rows("a_free_wet", a_free_wet_);
  rows("f_link", f_link_);
  rows("step_of_wet", step_of_wet_);
  archive("t_origin", t_origin_);
  archive("dt", dt_);
  archive("steps_of_dt", steps_of_dt_);
  archive("step", step_);
  archive("gravity_reference", gravity_reference_);
  rows("external_work", external_work_);
  rows("interface_work", interface_work_);
  rows("viscous_work", viscous_work_);
  rows("contact_work", contact_work_);
  archive("beam", beam_);
  archive("face_force", face_force_);
  archive_driven(archive, "driven_fibres", driven_fibres_, [this](const auto&) { return share_.is_first(); });
  archive("theta_sent", theta_sent_);
  archive("frequency_ratio", frequency_ratio_);
  archive("measured_bound", measured_bound_);
  archive("measured_step", measured_step_);
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
