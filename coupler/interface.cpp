// Mortar of every interface, one operator for all.
#include "coupler/interface.hpp"

#include "common/error.hpp"
#include "coupler/mortar.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace undine::coupler
{

namespace
{

/// M⁻¹ of the wet nodes: a block per node, and two for each pair of nodes that move each other.
SparseMatrix inverse_mass_of(const link::SurfaceMesh& surface)
{
  const int dim = surface.dim;
  std::vector<Eigen::Triplet<double>> entries;
  for (std::int64_t n = 0; n < surface.n_nodes(); ++n)
    for (int i = 0; i < dim; ++i)
      for (int j = 0; j < dim; ++j)
        if (const double w = surface.inverse_mass[static_cast<std::size_t>((n * dim + i) * dim + j)];
            w != 0.0)
          entries.emplace_back(n * dim + i, n * dim + j, w);
  for (std::size_t p = 0; 2 * p < surface.coupled_nodes.size(); ++p)
    for (int i = 0; i < dim; ++i)
      for (int j = 0; j < dim; ++j)
      {
        const auto row = static_cast<int>(surface.coupled_nodes[2 * p]) * dim + i;
        const auto column = static_cast<int>(surface.coupled_nodes[2 * p + 1]) * dim + j;
        const double w =
            surface.coupled_inverse_mass[(p * static_cast<std::size_t>(dim) + static_cast<std::size_t>(i)) *
                                             static_cast<std::size_t>(dim) +
                                         static_cast<std::size_t>(j)];
        entries.emplace_back(row, column, w);
        entries.emplace_back(column, row, w);
      }
  SparseMatrix W(surface.n_nodes() * dim, surface.n_nodes() * dim);
  W.setFromTriplets(entries.begin(), entries.end());
  return W;
}

template <int dim>
InterfaceReport append_interface(const InterfaceConfig& config, double search_distance,
                                 const std::array<const link::SurfaceMesh*, 2>& surface, double least_cover,
                                 ConstraintRows& rows, const link::Team* team)
{
  std::array<InterfaceFaces<dim>, 2> faces;
  for (const Side s : both_sides)
  {
    faces[s] = faces_of<dim>(*surface[s], config.name);
    if (faces[s].faces.empty())
      throw InputError(fmt::format("interface '{}': the {} side has no faces on surface '{}'", config.name,
                                   s == Side::fluid ? "fluid" : "solid",
                                   s == Side::fluid ? config.fluid : config.solid));
  }
  const bool fluid_is_finer = faces[Side::fluid].mean_face_size() <= faces[Side::solid].mean_face_size();
  const Side multiplier_side = config.multiplier == "fluid"   ? Side::fluid
                               : config.multiplier == "solid" ? Side::solid
                               : fluid_is_finer               ? Side::fluid
                                                              : Side::solid;
  const double coarser = std::max(faces[0].mean_face_size(), faces[1].mean_face_size());
  const double distance = search_distance > 0.0 ? search_distance : 0.5 * coarser;
  const auto mortar =
      integrate_mortar<dim>(faces[multiplier_side], faces[other(multiplier_side)], distance, team);

  InterfaceReport report;
  report.name = config.name;
  report.multiplier_side = multiplier_side;
  report.multipliers = static_cast<int>(mortar.D.size());
  report.largest_gap = mortar.largest_gap;
  for (const Side s : both_sides)
  {
    report.measure[s] = faces[s].total_measure();
    report.face_size[s] = faces[s].mean_face_size();
    report.covered[s] = mortar.covered[s == multiplier_side ? 0 : 1];
  }
  const Side smaller = report.measure[Side::fluid] <= report.measure[Side::solid] ? Side::fluid : Side::solid;
  if (!(report.covered[smaller] >= least_cover))
    throw InputError(fmt::format(
        "interface '{}': only {:.3g} % of the {} side ({:.4g} of {:.4g} m{}) finds a face of the other "
        "within {:.3g} m. Check units, positions and outward normals, or raise coupling.search_distance",
        config.name, 100.0 * report.covered[smaller], smaller == Side::fluid ? "fluid" : "solid",
        report.covered[smaller] * report.measure[smaller], report.measure[smaller], dim == 3 ? "²" : "",
        distance));
  report.rows.first = rows.count;
  append_constraints<dim>(mortar, multiplier_side,
                          config.kind == "slip" ? InterfaceKind::slip : InterfaceKind::no_slip, rows);
  report.rows.second = rows.count;
  return report;
}

Solver solver_for(const CouplingConfig& coupling, int dim, int multipliers)
{
  if (coupling.lumped)
    return Solver::row_sums;
  const bool large = dim == 3 && multipliers >= gradients_from;
  return coupling.solver == "gradients" || (coupling.solver == "auto" && large) ? Solver::gradients
                                                                                : Solver::factor;
}

} // namespace

Interface::Interface(const CouplingConfig& coupling, link::SurfaceMesh fluid, link::SurfaceMesh solid,
                     double least_cover, const link::Team* team)
    : coupling_(coupling), least_cover_(least_cover), team_(team)
{
  require(fluid.dim == solid.dim, "both participants have the same dimension");
  replace_surface(Side::fluid, std::move(fluid));
  replace_surface(Side::solid, std::move(solid));
}

void Interface::replace_surface(Side side, link::SurfaceMesh surface)
{
  surface_[side] = std::move(surface);
  x_message_[side] = surface_[side].x;
}

void Interface::move(Side side, const Vector& travel)
{
  for (std::size_t k = 0; k < x_message_[side].size(); ++k)
    surface_[side].x[k] = x_message_[side][k] + travel[static_cast<Eigen::Index>(k)];
}

bool Interface::has_deformed() const
{
  constexpr double unchanged = 1e-6; // of a face: C and the normals change by as much
  const auto dim = static_cast<std::size_t>(surface_[Side::fluid].dim);
  for (std::size_t i = 0; i < dim; ++i)
  {
    double least = std::numeric_limits<double>::max(), most = std::numeric_limits<double>::lowest();
    for (const Side s : both_sides)
    {
      if (x_built_[s].size() != surface_[s].x.size())
        return true;
      for (std::size_t k = i; k < x_built_[s].size(); k += dim)
      {
        const double d = surface_[s].x[k] - x_built_[s][k];
        least = std::min(least, d);
        most = std::max(most, d);
      }
    }
    if (most - least > unchanged * face_size_)
      return true;
  }
  return false;
}

InterfaceOperator Interface::build()
{
  const std::array<const link::SurfaceMesh*, 2> surface{&surface_[Side::fluid], &surface_[Side::solid]};
  ConstraintRows rows;
  report_.clear();
  for (const InterfaceConfig& config : coupling_.interfaces)
    report_.push_back(
        surface[0]->dim == 2
            ? append_interface<2>(config, coupling_.search_distance, surface, least_cover_, rows, team_)
            : append_interface<3>(config, coupling_.search_distance, surface, least_cover_, rows, team_));
  face_size_ = std::numeric_limits<double>::max();
  for (const InterfaceReport& r : report_)
    face_size_ = std::min({face_size_, r.face_size[Side::fluid], r.face_size[Side::solid]});

  std::array<InterfaceSide, 2> side;
  for (const Side s : both_sides)
  {
    x_built_[s] = surface_[s].x;
    side[s].L = SparseMatrix(rows.count, surface_[s].n_nodes() * surface_[s].dim);
    side[s].L.setFromTriplets(rows.entries[s].begin(), rows.entries[s].end());
    side[s].inverse_mass = inverse_mass_of(surface_[s]);
  }
  ++builds_;
  return {std::move(side[Side::fluid]), std::move(side[Side::solid]),
          solver_for(coupling_, surface[0]->dim, rows.count), team_};
}

void archive_surface(StateArchive& archive, const std::string& name, link::SurfaceMesh& m)
{
  archive(name + "/dim", m.dim);
  archive(name + "/epoch", m.epoch);
  archive(name + "/interfaces", m.interfaces);
  archive(name + "/node_id", m.node_id);
  archive(name + "/x", m.x);
  archive(name + "/inverse_mass", m.inverse_mass);
  archive(name + "/face_offset", m.face_offset);
  archive(name + "/face_nodes", m.face_nodes);
  archive(name + "/face_interface", m.face_interface);
}

InterfaceOperator Interface::build_again()
{
  const std::array<std::vector<double>, 2> now{surface_[0].x, surface_[1].x};
  const std::int64_t builds = builds_;
  for (const Side s : both_sides)
    surface_[s].x = x_built_[s];
  InterfaceOperator H = build();
  for (const Side s : both_sides)
    surface_[s].x = now[s];
  builds_ = builds;
  return H;
}

void Interface::for_each_state(StateArchive& archive)
{
  for (const Side s : both_sides)
  {
    link::SurfaceMesh& m = surface_[s];
    const std::string side = s == Side::fluid ? "fluid_" : "solid_";
    auto node_id = m.node_id;
    archive(side + "node_id", node_id);
    if (node_id != m.node_id)
      throw Failure(ExitCode::bad_input_file,
                    fmt::format("restart: the wet nodes that the {} has sent are not those of the checkpoint",
                                s == Side::fluid ? "fluid" : "solid"));
    archive_surface(archive, side + "surface", m);
    archive(side + "x_message", x_message_[s]);
    archive(side + "x_built", x_built_[s]);
  }
  archive("builds", builds_);
}

} // namespace undine::coupler
