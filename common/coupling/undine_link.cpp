// The C interface: SolverLink behind an opaque handle, exceptions turned into return codes.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/undine_link.h"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/failure.hpp"
#include "common/coupling/solver_handle.hpp"
#include "common/coupling/start_timer.hpp"

#include <algorithm>
#include <exception>
#include <memory>
#include <string>

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

/// Runs body(link's conversation) as guarded() does, if there is one.
template <class Body>
int talking(undine_link* link, const char* function, Body&& body) noexcept
{
  return guarded(link, [&] { body(conversation(link, function)); });
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
    return talking(link, "undine_receive_setup",
                   [&](SolverLink&)
                   {
                     require(setup != nullptr, "undine_receive_setup: setup is NULL");
                     link->setup = receive_setup(*link);
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
    return talking(link, "undine_receive_surface",
                   [&](SolverLink&)
                   {
                     require(surface != nullptr, "undine_receive_surface: surface is NULL");
                     link->partner_surface = receive_surface(*link);
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
    return talking(link, "undine_set_nodes",
                   [&](SolverLink&)
                   {
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
    return talking(link, "undine_set_nodes_with_matrix",
                   [&](SolverLink&)
                   {
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
    return talking(link, "undine_add_faces",
                   [&](SolverLink&)
                   {
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
                     append_faces(*link, interface, n_faces, nodes_per_face);
                   });
  }

  int undine_add_faces_by_id(undine_link* link, const char* interface_name, int64_t n_faces,
                             int32_t nodes_per_face, const int64_t* node_ids)
  {
    return talking(
        link, "undine_add_faces_by_id",
        [&](SolverLink&)
        {
          require(link->team.has_value(),
                  "undine_add_faces_by_id is for ranks after undine_distribute; undine_add_faces "
                  "takes positions");
          require_faces("undine_add_faces_by_id", interface_name, node_ids, n_faces, nodes_per_face);
          const auto interface = interface_index(*link, interface_name, "undine_add_faces_by_id");
          link->face_ids.insert(link->face_ids.end(), node_ids, node_ids + n_faces * nodes_per_face);
          append_faces(*link, interface, n_faces, nodes_per_face);
        });
  }

  int undine_send_surface(undine_link* link)
  {
    return talking(link, "undine_send_surface", [link](SolverLink&) { send_surface(*link); });
  }

  int undine_send_report(undine_link* link, const undine_report* report)
  {
    return talking(link, "undine_send_report",
                   [&](SolverLink& talk)
                   {
                     require(report != nullptr, "undine_send_report: report is NULL");
                     require(report->stable_dt > 0.0,
                             "undine_send_report: stable_dt = " + std::to_string(report->stable_dt) +
                                 " s must be positive");
                     talk.send_report(report_of(*link, *report));
                   });
  }

  int undine_offer_checkpoints(undine_link* link)
  {
    return talking(link, "undine_offer_checkpoints",
                   [&](SolverLink&)
                   {
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
    return talking(link, "undine_checkpoint_done",
                   [&](SolverLink& talk)
                   {
                     CheckpointDone done{.written = file_name != nullptr};
                     if (file_name != nullptr)
                       done.files = {file_name};
                     else
                       done.reason = reason != nullptr ? reason : "no reason given";
                     if (is_first(*link))
                       talk.send_checkpoint_done(done);
                   });
  }

  int undine_next_window(undine_link* link, undine_window* window)
  {
    int ended = UNDINE_OK;
    const int code = talking(link, "undine_next_window",
                             [&](SolverLink&)
                             {
                               require(window != nullptr, "undine_next_window: window is NULL");
                               const auto order = next_order(*link);
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
    return talking(link, "undine_send_kinematics",
                   [&](SolverLink& talk)
                   {
                     const auto velocity = in_link_order(*link, v, "v", link->rows),
                                acceleration = in_link_order(*link, a_free, "a_free", link->more_rows);
                     talk.send_kinematics({.v = {velocity.begin(), velocity.end()},
                                           .a_free = {acceleration.begin(), acceleration.end()}});
                   });
  }

  int undine_receive_activation(undine_link* link, double* impulse, double* link_force)
  {
    return talking(link, "undine_receive_activation",
                   [&](SolverLink& talk)
                   {
                     const auto p = vector(*link, impulse, "impulse"),
                                f = vector(*link, link_force, "link_force");
                     const Activation start = talk.receive_activation();
                     in_given_order(*link, start.impulse, p);
                     in_given_order(*link, start.link_force, f);
                   });
  }

  int undine_send_free_velocity(undine_link* link, const double* v_free)
  {
    return talking(link, "undine_send_free_velocity",
                   [&](SolverLink& talk)
                   { talk.send_free_velocity(in_link_order(*link, v_free, "v_free", link->rows)); });
  }

  int undine_receive_link_force(undine_link* link, double* link_force)
  {
    return talking(link, "undine_receive_link_force",
                   [&](SolverLink& talk)
                   {
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
    return talking(link, "undine_send_motion",
                   [&](SolverLink& talk)
                   {
                     const auto position = in_link_order(*link, x, "x", link->rows),
                                velocity = in_link_order(*link, v, "v", link->more_rows);
                     talk.send_motion(
                         {.x = {position.begin(), position.end()}, .v = {velocity.begin(), velocity.end()}});
                   });
  }

  int undine_request_stop(undine_link* link, const char* reason)
  {
    return talking(link, "undine_request_stop",
                   [&](SolverLink& talk)
                   {
                     if (is_first(*link))
                       talk.send_stop_request(reason != nullptr ? reason : "no reason given");
                   });
  }

  int undine_ping(undine_link* link)
  {
    return talking(link, "undine_ping", [](SolverLink& talk) { talk.ping(); });
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
