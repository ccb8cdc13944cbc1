// The C interface: SolverLink behind an opaque handle, exceptions turned into return codes.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/undine_link.h"

#include "common/coupling/bootstrap.hpp"
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/failure.hpp"
#include "common/coupling/link.hpp"
#include "common/coupling/start_timer.hpp"
#include "common/coupling/team.hpp"
#include "common/coupling/wire.hpp"

#include <algorithm>
#include <cstring>
#include <exception>
#include <limits>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <vector>

struct undine_link
{
  std::string role;
  std::unique_ptr<undine::link::World> world;
  std::optional<undine::link::SolverLink> conversation; ///< on rank 0 of the role; distributed: on all
  double stall_seconds = 0.0;
  std::optional<undine::link::Team> team; ///< distributed
  undine::link::Setup setup;
  bool has_setup = false;
  undine::link::SurfaceMesh surface; ///< distributed: nodes of this rank
  /// Distributed: faces of this rank by node_id, and the place in this rank's arrays of each row of its
  /// vectors.
  std::vector<std::int64_t> face_ids;
  std::vector<std::size_t> place;
  std::vector<double> rows, more_rows;
  undine::link::SurfaceMesh partner_surface;
  bool surface_was_sent = false;
  bool offers_checkpoints = false;
  undine::link::CheckpointOrder checkpoint;
  std::string last_error;
};

namespace
{

using namespace undine::link;

/// Words of a failure without a link.
std::string& error_without_link()
{
  static thread_local std::string text;
  return text;
}

std::string& error_of(undine_link* link) { return link != nullptr ? link->last_error : error_without_link(); }

/// Keeps the words if memory allows.
int fail(undine_link* link, int code, const char* text) noexcept
{
  try
  {
    error_of(link) = text;
  }
  catch (...)
  {
  }
  return code;
}

/// Runs `body`; whatever it throws becomes a code and words.
template <class Body>
int guarded(undine_link* link, Body&& body) noexcept
{
  try
  {
    body();
    return UNDINE_OK;
  }
  catch (const ProtocolError& error)
  {
    return fail(link, error.code(), error.what());
  }
  catch (const std::exception& error)
  {
    return fail(link, code::internal_error, error.what());
  }
  catch (...)
  {
    return fail(link, code::internal_error, "an unknown C++ exception");
  }
}

void require(bool holds, const std::string& text)
{
  if (!holds)
    throw ProtocolError(code::internal_error, text);
}

/// The conversation of a valid handle. @throws ProtocolError(1)
SolverLink& conversation(undine_link* link, const char* function)
{
  require(link != nullptr, std::string(function) + ": the link is NULL; undine_open first");
  require(link->conversation.has_value(), std::string(function) + " was called on another rank than 0 of '" +
                                              link->role +
                                              "'; only rank 0 of undine_comm() talks to the coupler, or all "
                                              "after undine_distribute");
  return *link->conversation;
}

bool is_first(const undine_link& link) { return !link.team || link.team->rank() == 0; }

/// What rank 0 gets by `receive`, on all ranks; so is its failure.
template <class Receive, class Write, class Read>
auto told(undine_link& link, Receive&& receive, Write&& write, Read&& read) -> decltype(receive())
{
  if (!link.team)
    return receive();
  std::vector<std::byte> bytes;
  wire::Writer out(bytes);
  if (link.team->rank() == 0)
  {
    std::optional<decltype(receive())> content;
    try
    {
      content = receive();
    }
    catch (const ProtocolError& error)
    {
      out.i32(error.code());
      out.string(error.what());
      link.team->tell(std::move(bytes));
      throw;
    }
    out.i32(UNDINE_OK);
    write(out, *content);
    link.team->tell(std::move(bytes));
    return *content;
  }
  bytes = link.team->tell({});
  wire::Reader in(bytes, "the word of rank 0");
  if (const int code = in.i32("code"); code != UNDINE_OK)
    throw ProtocolError(code, in.string("text"));
  return read(std::span<const std::byte>(bytes).subspan(sizeof(std::int32_t)));
}

const auto write_content = [](wire::Writer& out, const auto& content) { wire::write(out, content); };

/// Numbers in a vector of the wet surface.
std::size_t vector_size(const undine_link& link)
{
  return static_cast<std::size_t>(link.surface.n_nodes()) * static_cast<std::size_t>(link.surface.dim);
}

std::span<const double> vector(const undine_link& link, const double* values, const char* name)
{
  require(values != nullptr || vector_size(link) == 0, std::string(name) + " is NULL");
  return {values, vector_size(link)};
}

/// The rows of `values` in the order of the link's vectors; `room` is used if that is another.
std::span<const double> in_link_order(const undine_link& link, const double* values, const char* name,
                                      std::vector<double>& room)
{
  const auto given = vector(link, values, name);
  if (!link.team)
    return given;
  const auto dim = static_cast<std::size_t>(link.surface.dim);
  room.resize(given.size());
  for (std::size_t k = 0; k < link.place.size(); ++k)
    std::copy_n(given.begin() + static_cast<std::ptrdiff_t>(link.place[k] * dim), dim,
                room.begin() + static_cast<std::ptrdiff_t>(k * dim));
  return room;
}

/// The way back.
void in_given_order(const undine_link& link, std::span<const double> rows, std::span<double> values)
{
  const auto dim = static_cast<std::size_t>(link.surface.dim);
  for (std::size_t k = 0; k < values.size() / dim; ++k)
    std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(k * dim), dim,
                values.begin() + static_cast<std::ptrdiff_t>((link.team ? link.place[k] : k) * dim));
}

std::span<double> vector(const undine_link& link, double* values, const char* name)
{
  require(values != nullptr || vector_size(link) == 0, std::string(name) + " is NULL");
  return {values, vector_size(link)};
}

/// Starts a new surface: nodes without masses, no faces.
void begin_surface(undine_link& link, int64_t n, const int64_t* node_id, const double* x)
{
  require(link.has_setup, "the surface comes after undine_receive_setup");
  require(n >= 0 && n <= std::numeric_limits<int32_t>::max(), "n = " + std::to_string(n) + " wet nodes");
  require(x != nullptr || n == 0, "x is NULL");
  const auto count = static_cast<std::size_t>(n);
  const auto dim = static_cast<std::size_t>(link.setup.dim);
  SurfaceMesh surface;
  surface.dim = link.setup.dim;
  surface.epoch = link.surface_was_sent ? link.surface.epoch + 1 : 0;
  surface.interfaces = link.setup.interfaces;
  surface.node_id.resize(count);
  for (std::size_t k = 0; k < count; ++k)
    surface.node_id[k] = node_id != nullptr ? node_id[k] : static_cast<int64_t>(k);
  surface.x.assign(x, x + count * dim);
  surface.inverse_mass.assign(count * dim * dim, 0.0);
  link.surface = std::move(surface);
  link.face_ids.clear();
  if (!link.team)
    return;
  require(node_id != nullptr || n == 0, "node_id is NULL: after undine_distribute nodes have global numbers");
  link.place.resize(count);
  for (std::size_t k = 0; k < count; ++k)
    link.place[k] = k;
  std::sort(link.place.begin(), link.place.end(),
            [node_id](std::size_t a, std::size_t b) { return node_id[a] < node_id[b]; });
}

/// Index of an interface of the set-up. @throws ProtocolError(1)
std::int32_t interface_index(const undine_link& link, const char* name, const char* function)
{
  const auto& names = link.surface.interfaces;
  const auto found = std::find(names.begin(), names.end(), name);
  std::string known;
  for (const auto& one : names)
    known += (known.empty() ? "" : ", ") + one;
  require(found != names.end(),
          std::string(function) + ": the case has no interface '" + name + "'; it has: " + known);
  return static_cast<std::int32_t>(found - names.begin());
}

void require_faces(const char* function, const char* interface_name, const void* nodes, int64_t n_faces,
                   int32_t nodes_per_face)
{
  require(interface_name != nullptr && (nodes != nullptr || n_faces == 0),
          std::string(function) + ": a pointer is NULL");
  require(n_faces >= 0 && nodes_per_face >= 2 && nodes_per_face <= 4,
          std::string(function) + ": " + std::to_string(n_faces) + " faces of " +
              std::to_string(nodes_per_face) + " nodes");
}

/// Parts of all ranks as one surface: nodes by number, faces by interface and the numbers of their nodes,
/// whoever gave them.
SurfaceMesh joined(const undine_link& link, const std::vector<std::vector<std::byte>>& parts)
{
  struct Node
  {
    std::int32_t owner;
    std::vector<double> x, inverse_mass;
  };
  std::map<std::int64_t, Node> nodes;
  std::vector<std::pair<std::int32_t, std::vector<std::int64_t>>> faces;
  const auto dim = static_cast<std::size_t>(link.setup.dim);
  for (std::size_t rank = 0; rank < parts.size(); ++rank)
  {
    wire::Reader in(parts[rank], "the surface of rank " + std::to_string(rank));
    const auto id = in.i64_list("node_id");
    const auto x = in.f64_list("x"), W = in.f64_list("inverse_mass");
    const auto offset = in.i32_list("face_offset"), interface = in.i32_list("face_interface");
    const auto face_ids = in.i64_list("face_nodes");
    for (std::size_t k = 0; k < id.size(); ++k)
    {
      const auto rows = [k](const std::vector<double>& all, std::size_t width)
      {
        return std::vector<double>(all.begin() + static_cast<std::ptrdiff_t>(k * width),
                                   all.begin() + static_cast<std::ptrdiff_t>((k + 1) * width));
      };
      const auto [place, is_new] =
          nodes.try_emplace(id[k], Node{static_cast<std::int32_t>(rank), rows(x, dim), rows(W, dim * dim)});
      require(is_new, "undine_send_surface: node " + std::to_string(id[k]) + " was given by rank " +
                          std::to_string(place->second.owner) + " and by rank " + std::to_string(rank) +
                          "; each node belongs to one rank");
    }
    for (std::size_t f = 0; f + 1 < offset.size(); ++f)
      faces.emplace_back(interface[f], std::vector<std::int64_t>(face_ids.begin() + offset[f],
                                                                 face_ids.begin() + offset[f + 1]));
  }
  std::sort(faces.begin(), faces.end());

  SurfaceMesh all;
  all.dim = link.surface.dim;
  all.epoch = link.surface.epoch;
  all.interfaces = link.surface.interfaces;
  std::map<std::int64_t, std::int32_t> position;
  for (const auto& [id, node] : nodes)
  {
    position.emplace(id, static_cast<std::int32_t>(all.node_id.size()));
    all.node_id.push_back(id);
    all.x.insert(all.x.end(), node.x.begin(), node.x.end());
    all.inverse_mass.insert(all.inverse_mass.end(), node.inverse_mass.begin(), node.inverse_mass.end());
    all.owner.push_back(node.owner);
  }
  for (const auto& [interface, ids] : faces)
  {
    for (const std::int64_t id : ids)
    {
      const auto found = position.find(id);
      require(found != position.end(), "undine_send_surface: a face has node " + std::to_string(id) +
                                           ", which no rank has given by undine_set_nodes");
      all.face_nodes.push_back(found->second);
    }
    all.face_offset.push_back(static_cast<std::int32_t>(all.face_nodes.size()));
    all.face_interface.push_back(interface);
  }
  if (std::all_of(all.owner.begin(), all.owner.end(), [](std::int32_t r) { return r == 0; }))
    all.owner.clear();
  return all;
}

void send_joined_surface(undine_link& link)
{
  std::vector<std::byte> mine;
  wire::Writer out(mine);
  out.list<std::int64_t>(link.surface.node_id);
  out.list<double>(link.surface.x);
  out.list<double>(link.surface.inverse_mass);
  out.list<std::int32_t>(link.surface.face_offset);
  out.list<std::int32_t>(link.surface.face_interface);
  out.list<std::int64_t>(link.face_ids);
  const auto parts = link.team->collect(mine);
  const auto send = [&link](const SurfaceMesh& surface)
  {
    if (link.surface_was_sent)
      link.conversation->send_mesh_update(surface);
    else
      link.conversation->send_mesh(surface);
  };
  told(
      link,
      [&]
      {
        send(joined(link, parts));
        return true;
      },
      [](wire::Writer&, bool) {}, [](std::span<const std::byte>) { return true; });
  if (is_first(link))
    return;
  SurfaceMesh rows; // as much of it as the exchange of this rank's rows depends on
  rows.dim = link.surface.dim;
  rows.epoch = link.surface.epoch;
  rows.node_id = link.surface.node_id;
  rows.owner.assign(rows.node_id.size(), static_cast<std::int32_t>(link.team->rank()));
  send(rows);
}

Report report_of(const undine_link& link, const undine_report& r)
{
  Report report;
  report.stable_dt = r.stable_dt;
  report.kinetic_energy = r.kinetic_energy;
  report.internal_energy = r.internal_energy;
  report.external_work = r.external_work;
  report.dissipated_energy = r.dissipated_energy;
  report.interface_work = r.interface_work;
  report.mass = r.mass;
  report.steps = r.steps;
  report.surface_changed = r.surface_changed != 0;
  report.wait_seconds = link.conversation->wait_seconds();
  return report;
}

/// The next order that concerns the solver, on all ranks.
SolverLink::Order next_order(undine_link& link, SolverLink& talk)
{
  enum : std::uint8_t
  {
    end,
    window,
    checkpoint
  };
  const auto order = told(
      link,
      [&]
      {
        auto next = talk.next_order();
        while (!link.offers_checkpoints && std::holds_alternative<CheckpointOrder>(next))
        {
          talk.send_checkpoint_done({.reason = "this solver writes no checkpoints"});
          next = talk.next_order();
        }
        return next;
      },
      [](wire::Writer& out, const SolverLink::Order& next)
      {
        out.u8(static_cast<std::uint8_t>(next.index())); // the order of the variant's types is that above
        if (const auto* w = std::get_if<Window>(&next))
          wire::write(out, *w);
        if (const auto* c = std::get_if<CheckpointOrder>(&next))
          wire::write(out, *c);
      },
      [](std::span<const std::byte> bytes) -> SolverLink::Order
      {
        const auto kind = std::to_integer<std::uint8_t>(bytes[0]);
        const wire::Reader in(bytes.subspan(1), "the order");
        if (kind == window)
          return wire::read_window(in);
        if (kind == checkpoint)
          return wire::read_checkpoint_order(in);
        return {};
      });
  if (is_first(link))
    return order;
  if (const auto* next = std::get_if<Window>(&order))
    talk.hear(*next);
  else if (std::holds_alternative<std::monostate>(order))
    talk.hear_end();
  return order;
}

/// Hand-shake of either level.
int open_link(undine_link** link, const char* role, const char* solver, std::uint64_t capabilities,
              double hello_seconds, double stall_seconds)
{
  if (link == nullptr)
    return fail(nullptr, code::internal_error, "undine_open: link is NULL");
  *link = nullptr;
  return guarded(nullptr,
                 [&]
                 {
                   require(role != nullptr && solver != nullptr, "undine_open: role or solver is NULL");
                   auto opened = std::make_unique<undine_link>();
                   opened->role = role;
                   opened->world = std::make_unique<World>(
                       World::connect({.role = role,
                                       .solver = solver,
                                       .partners = {"coupler"},
                                       .capabilities = capabilities | capability::distributed},
                                      {.hello = hello_seconds, .stall = stall_seconds}));
                   opened->stall_seconds = stall_seconds;
                   if (auto channel = opened->world->channel("coupler"))
                     opened->conversation.emplace(std::move(channel));
                   *link = opened.release();
                 });
}

} // namespace

extern "C"
{

  void undine_protocol_version(int* major, int* minor)
  {
    if (major != nullptr)
      *major = protocol_major;
    if (minor != nullptr)
      *minor = protocol_minor;
  }

  int undine_arm(const char* role, double seconds)
  {
    return guarded(nullptr,
                   [&]
                   {
                     require(role != nullptr, "undine_arm: role is NULL");
                     arm_start_timer(role, seconds);
                   });
  }

  int undine_open(undine_link** link, const char* role, const char* solver, double hello_seconds,
                  double stall_seconds)
  {
    return open_link(link, role, solver, capability::link, hello_seconds, stall_seconds);
  }

  int undine_open_force_in(undine_link** link, const char* role, const char* solver, double hello_seconds,
                           double stall_seconds)
  {
    return open_link(link, role, solver, capability::force_in, hello_seconds, stall_seconds);
  }

  int undine_open_contact(undine_link** link, const char* role, const char* solver, double hello_seconds,
                          double stall_seconds)
  {
    return open_link(link, role, solver, capability::link | capability::contact, hello_seconds,
                     stall_seconds);
  }

  int undine_distribute(undine_link* link)
  {
    return guarded(link,
                   [&]
                   {
                     require(link != nullptr, "undine_distribute: the link is NULL; undine_open first");
                     require(!link->has_setup && !link->team,
                             "undine_distribute comes once, before undine_receive_setup");
                     if ((link->world->capabilities_of("coupler") & capability::distributed) == 0)
                       throw ProtocolError(code::missing_role,
                                           "this coupler (" + link->world->solver_of("coupler") +
                                               ") takes all rows of a surface from rank 0 (it does not offer "
                                               "DISTRIBUTED); gather them there");
                     link->team.emplace(link->world->comm(), 2.0 * link->stall_seconds);
                     if (!link->conversation)
                       link->conversation.emplace(link->world->path("coupler", 0), link->team->rank());
                   });
  }

  MPI_Comm undine_comm(const undine_link* link)
  {
    return link != nullptr ? link->world->comm() : MPI_COMM_NULL;
  }
  MPI_Fint undine_comm_f(const undine_link* link) { return MPI_Comm_c2f(undine_comm(link)); }

  const char* undine_last_error(const undine_link* link)
  {
    return link != nullptr ? link->last_error.c_str() : error_without_link().c_str();
  }

  int undine_receive_setup(undine_link* link, undine_setup* setup)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_receive_setup");
                     require(setup != nullptr, "undine_receive_setup: setup is NULL");
                     link->setup = told(
                         *link, [&] { return talk.receive_setup(); }, write_content,
                         [](std::span<const std::byte> bytes)
                         { return wire::read_setup(wire::Reader(bytes, "SETUP")); });
                     if (!is_first(*link))
                       talk.hear(link->setup);
                     link->has_setup = true;
                     if (!link->setup.restart.empty() && !link->offers_checkpoints)
                       throw ProtocolError(code::bad_case, "the run continues from " + link->setup.restart +
                                                               ", but this solver cannot: it offers no "
                                                               "checkpoints");
                     *setup = {.dim = link->setup.dim,
                               .n_interfaces = static_cast<int32_t>(link->setup.interfaces.size()),
                               .t_begin = link->setup.t_begin,
                               .t_end = link->setup.t_end};
                   });
  }

  const char* undine_interface_name(const undine_link* link, int32_t i)
  {
    if (link == nullptr || i < 0 || static_cast<std::size_t>(i) >= link->setup.interfaces.size())
      return nullptr;
    return link->setup.interfaces[static_cast<std::size_t>(i)].c_str();
  }

  int undine_in_contact(const undine_link* link)
  {
    return link != nullptr &&
           (link->setup.scheme == contact_scheme || link->setup.scheme == contact_surface_scheme);
  }

  int undine_receive_surface(undine_link* link, undine_surface* surface)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_receive_surface");
                     require(surface != nullptr, "undine_receive_surface: surface is NULL");
                     link->partner_surface = told(
                         *link, [&] { return talk.receive_surface(); }, write_content,
                         [](std::span<const std::byte> bytes)
                         { return wire::read_surface_mesh(wire::Reader(bytes, "SURFACE")); });
                     if (!is_first(*link))
                       talk.hear(link->partner_surface);
                     const auto& s = link->partner_surface;
                     *surface = {.n_nodes = s.n_nodes(),
                                 .n_faces = s.n_faces(),
                                 .x = s.x.data(),
                                 .face_offset = s.face_offset.data(),
                                 .face_nodes = s.face_nodes.data()};
                   });
  }

  int undine_set_nodes(undine_link* link, int64_t n, const int64_t* node_id, const double* x,
                       const double* mass, const int32_t* fixed)
  {
    return guarded(link,
                   [&]
                   {
                     conversation(link, "undine_set_nodes");
                     require(mass != nullptr || n == 0, "undine_set_nodes: mass is NULL");
                     for (int64_t k = 0; k < n; ++k)
                       require(mass[k] > 0.0, "undine_set_nodes: mass[" + std::to_string(k) +
                                                  "] = " + std::to_string(mass[k]) + " kg must be positive");
                     begin_surface(*link, n, node_id, x);
                     const auto dim = static_cast<std::size_t>(link->setup.dim);
                     for (std::size_t k = 0; k < static_cast<std::size_t>(n); ++k)
                       for (std::size_t i = 0; i < dim; ++i)
                         if (fixed == nullptr || fixed[k * dim + i] == 0)
                           link->surface.inverse_mass[(k * dim + i) * dim + i] = 1.0 / mass[k];
                   });
  }

  int undine_set_nodes_with_matrix(undine_link* link, int64_t n, const int64_t* node_id, const double* x,
                                   const double* inverse_mass)
  {
    return guarded(link,
                   [&]
                   {
                     conversation(link, "undine_set_nodes_with_matrix");
                     require(inverse_mass != nullptr || n == 0,
                             "undine_set_nodes_with_matrix: inverse_mass is NULL");
                     begin_surface(*link, n, node_id, x);
                     auto& W = link->surface.inverse_mass;
                     std::copy_n(inverse_mass, W.size(), W.begin());
                   });
  }

  int undine_add_faces(undine_link* link, const char* interface_name, int64_t n_faces, int32_t nodes_per_face,
                       const int32_t* face_nodes)
  {
    return guarded(link,
                   [&]
                   {
                     conversation(link, "undine_add_faces");
                     require_faces("undine_add_faces", interface_name, face_nodes, n_faces, nodes_per_face);
                     auto& surface = link->surface;
                     const auto interface = interface_index(*link, interface_name, "undine_add_faces");
                     const auto size =
                         static_cast<std::size_t>(n_faces) * static_cast<std::size_t>(nodes_per_face);
                     for (std::size_t k = 0; k < size; ++k)
                       require(face_nodes[k] >= 0 && face_nodes[k] < surface.n_nodes(),
                               "undine_add_faces: face_nodes[" + std::to_string(k) +
                                   "] = " + std::to_string(face_nodes[k]) + " is no position in the " +
                                   std::to_string(surface.n_nodes()) + " wet nodes");
                     if (link->team)
                       for (std::size_t k = 0; k < size; ++k)
                         link->face_ids.push_back(surface.node_id[static_cast<std::size_t>(face_nodes[k])]);
                     else
                       surface.face_nodes.insert(surface.face_nodes.end(), face_nodes, face_nodes + size);
                     for (int64_t f = 0; f < n_faces; ++f)
                     {
                       surface.face_offset.push_back(surface.face_offset.back() + nodes_per_face);
                       surface.face_interface.push_back(interface);
                     }
                   });
  }

  int undine_add_faces_by_id(undine_link* link, const char* interface_name, int64_t n_faces,
                             int32_t nodes_per_face, const int64_t* node_ids)
  {
    return guarded(
        link,
        [&]
        {
          conversation(link, "undine_add_faces_by_id");
          require(link->team.has_value(),
                  "undine_add_faces_by_id is for ranks after undine_distribute; undine_add_faces "
                  "takes positions");
          require_faces("undine_add_faces_by_id", interface_name, node_ids, n_faces, nodes_per_face);
          const auto interface = interface_index(*link, interface_name, "undine_add_faces_by_id");
          link->face_ids.insert(link->face_ids.end(), node_ids, node_ids + n_faces * nodes_per_face);
          for (int64_t f = 0; f < n_faces; ++f)
          {
            link->surface.face_offset.push_back(link->surface.face_offset.back() + nodes_per_face);
            link->surface.face_interface.push_back(interface);
          }
        });
  }

  int undine_send_surface(undine_link* link)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_send_surface");
                     if (link->team)
                       send_joined_surface(*link);
                     else if (link->surface_was_sent)
                       talk.send_mesh_update(link->surface);
                     else
                       talk.send_mesh(link->surface);
                     link->surface_was_sent = true;
                   });
  }

  int undine_send_report(undine_link* link, const undine_report* report)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_send_report");
                     require(report != nullptr, "undine_send_report: report is NULL");
                     require(report->stable_dt > 0.0,
                             "undine_send_report: stable_dt = " + std::to_string(report->stable_dt) +
                                 " s must be positive");
                     talk.send_report(report_of(*link, *report));
                   });
  }

  int undine_offer_checkpoints(undine_link* link)
  {
    return guarded(link,
                   [&]
                   {
                     conversation(link, "undine_offer_checkpoints");
                     require(!link->has_setup, "undine_offer_checkpoints comes before undine_receive_setup");
                     link->offers_checkpoints = true;
                   });
  }

  const char* undine_restart_folder(const undine_link* link)
  {
    return link != nullptr && !link->setup.restart.empty() ? link->setup.restart.c_str() : nullptr;
  }

  const char* undine_checkpoint_folder(const undine_link* link)
  {
    return link != nullptr && !link->checkpoint.folder.empty() ? link->checkpoint.folder.c_str() : nullptr;
  }

  int undine_checkpoint_done(undine_link* link, const char* file_name, const char* reason)
  {
    return guarded(link,
                   [&]
                   {
                     CheckpointDone done{.written = file_name != nullptr};
                     if (file_name != nullptr)
                       done.files = {file_name};
                     else
                       done.reason = reason != nullptr ? reason : "no reason given";
                     auto& talk = conversation(link, "undine_checkpoint_done");
                     if (is_first(*link))
                       talk.send_checkpoint_done(done);
                   });
  }

  int undine_next_window(undine_link* link, undine_window* window)
  {
    int ended = UNDINE_OK;
    const int code = guarded(link,
                             [&]
                             {
                               auto& talk = conversation(link, "undine_next_window");
                               require(window != nullptr, "undine_next_window: window is NULL");
                               const auto order = next_order(*link, talk);
                               if (const auto* checkpoint = std::get_if<CheckpointOrder>(&order))
                               {
                                 link->checkpoint = *checkpoint;
                                 ended = UNDINE_CHECKPOINT;
                                 return;
                               }
                               const Window* next = std::get_if<Window>(&order);
                               if (next == nullptr)
                                 ended = UNDINE_END;
                               else
                                 *window = {.index = next->index,
                                            .steps = next->steps,
                                            .t_begin = next->t_begin,
                                            .t_end = next->t_end,
                                            .fine = next->fine,
                                            .activate = next->activate,
                                            .output = next->output,
                                            .last = next->last};
                             });
    return code == UNDINE_OK ? ended : code;
  }

  int undine_send_kinematics(undine_link* link, const double* v, const double* a_free)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_send_kinematics");
                     const auto velocity = in_link_order(*link, v, "v", link->rows),
                                acceleration = in_link_order(*link, a_free, "a_free", link->more_rows);
                     talk.send_kinematics({.v = {velocity.begin(), velocity.end()},
                                           .a_free = {acceleration.begin(), acceleration.end()}});
                   });
  }

  int undine_receive_activation(undine_link* link, double* impulse, double* link_force)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_receive_activation");
                     const auto p = vector(*link, impulse, "impulse"),
                                f = vector(*link, link_force, "link_force");
                     const Activation start = talk.receive_activation();
                     in_given_order(*link, start.impulse, p);
                     in_given_order(*link, start.link_force, f);
                   });
  }

  int undine_send_free_velocity(undine_link* link, const double* v_free)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_send_free_velocity");
                     talk.send_free_velocity(in_link_order(*link, v_free, "v_free", link->rows));
                   });
  }

  int undine_receive_link_force(undine_link* link, double* link_force)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_receive_link_force");
                     const auto f = vector(*link, link_force, "link_force");
                     if (!link->team)
                       return talk.receive_link_force(f);
                     link->rows.resize(f.size());
                     talk.receive_link_force(link->rows);
                     in_given_order(*link, link->rows, f);
                   });
  }

  int undine_exchange(undine_link* link, const double* v_free, double* link_force)
  {
    const int code = undine_send_free_velocity(link, v_free);
    return code != UNDINE_OK ? code : undine_receive_link_force(link, link_force);
  }

  int undine_send_motion(undine_link* link, const double* x, const double* v)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_send_motion");
                     const auto position = in_link_order(*link, x, "x", link->rows),
                                velocity = in_link_order(*link, v, "v", link->more_rows);
                     talk.send_motion(
                         {.x = {position.begin(), position.end()}, .v = {velocity.begin(), velocity.end()}});
                   });
  }

  int undine_request_stop(undine_link* link, const char* reason)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_request_stop");
                     if (is_first(*link))
                       talk.send_stop_request(reason != nullptr ? reason : "no reason given");
                   });
  }

  int undine_ping(undine_link* link)
  {
    return guarded(link, [&] { conversation(link, "undine_ping").ping(); });
  }

  double undine_wait_seconds(const undine_link* link)
  {
    return link != nullptr && link->conversation ? link->conversation->wait_seconds() : 0.0;
  }

  void undine_abort(undine_link* link, int code, const char* text, const char* out_dir)
  {
    const std::string words = text != nullptr ? text : undine_last_error(link);
    // A fault of the conversation itself (31 to 40) is not news that the conversation could carry.
    const bool of_protocol =
        code >= undine::link::code::mpi_start_incomplete && code <= undine::link::code::partner_failed;
    if (link != nullptr && link->conversation && !of_protocol)
      link->conversation->send_failure(code, words);
    abort_world(code, link != nullptr ? link->role : "solver", words, out_dir != nullptr ? out_dir : "");
  }

  void undine_close(undine_link* link) { delete link; }

} // extern "C"
