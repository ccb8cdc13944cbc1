// The C interface: SolverLink behind an opaque handle, exceptions turned into return codes.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/undine_link.h"

#include "common/coupling/bootstrap.hpp"
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/link.hpp"

#include <algorithm>
#include <cstring>
#include <exception>
#include <limits>
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
  std::optional<undine::link::SolverLink> conversation; ///< on rank 0 of the role
  undine::link::Setup setup;
  bool has_setup = false;
  undine::link::SurfaceMesh surface;
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
                                              "'; only rank 0 of undine_comm() talks to the coupler");
  return *link->conversation;
}

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
  return guarded(
      nullptr,
      [&]
      {
        require(role != nullptr && solver != nullptr, "undine_open: role or solver is NULL");
        auto opened = std::make_unique<undine_link>();
        opened->role = role;
        opened->world = std::make_unique<World>(World::connect(
            {.role = role, .solver = solver, .partners = {"coupler"}, .capabilities = capabilities},
            {.hello = hello_seconds, .stall = stall_seconds}));
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
                     link->setup = talk.receive_setup();
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
                     link->partner_surface = talk.receive_surface();
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
    return guarded(
        link,
        [&]
        {
          conversation(link, "undine_add_faces");
          require(interface_name != nullptr && (face_nodes != nullptr || n_faces == 0),
                  "undine_add_faces: a pointer is NULL");
          require(n_faces >= 0 && nodes_per_face >= 2 && nodes_per_face <= 4,
                  "undine_add_faces: " + std::to_string(n_faces) + " faces of " +
                      std::to_string(nodes_per_face) + " nodes");
          auto& surface = link->surface;
          const auto& names = surface.interfaces;
          const auto found = std::find(names.begin(), names.end(), interface_name);
          std::string known;
          for (const auto& name : names)
            known += (known.empty() ? "" : ", ") + name;
          require(found != names.end(), std::string("undine_add_faces: the case has no interface '") +
                                            interface_name + "'; it has: " + known);
          const auto size = static_cast<std::size_t>(n_faces) * static_cast<std::size_t>(nodes_per_face);
          for (std::size_t k = 0; k < size; ++k)
            require(face_nodes[k] >= 0 && face_nodes[k] < surface.n_nodes(),
                    "undine_add_faces: face_nodes[" + std::to_string(k) +
                        "] = " + std::to_string(face_nodes[k]) + " is no position in the " +
                        std::to_string(surface.n_nodes()) + " wet nodes");
          surface.face_nodes.insert(surface.face_nodes.end(), face_nodes, face_nodes + size);
          for (int64_t f = 0; f < n_faces; ++f)
          {
            surface.face_offset.push_back(surface.face_offset.back() + nodes_per_face);
            surface.face_interface.push_back(static_cast<int32_t>(found - names.begin()));
          }
        });
  }

  int undine_send_surface(undine_link* link)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_send_surface");
                     if (link->surface_was_sent)
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
                     conversation(link, "undine_checkpoint_done").send_checkpoint_done(done);
                   });
  }

  int undine_next_window(undine_link* link, undine_window* window)
  {
    int ended = UNDINE_OK;
    const int code =
        guarded(link,
                [&]
                {
                  auto& talk = conversation(link, "undine_next_window");
                  require(window != nullptr, "undine_next_window: window is NULL");
                  auto order = talk.next_order();
                  while (!link->offers_checkpoints && std::holds_alternative<CheckpointOrder>(order))
                  {
                    talk.send_checkpoint_done({.reason = "this solver writes no checkpoints"});
                    order = talk.next_order();
                  }
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
                     const auto velocity = vector(*link, v, "v"),
                                acceleration = vector(*link, a_free, "a_free");
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
                     std::copy(start.impulse.begin(), start.impulse.end(), p.begin());
                     std::copy(start.link_force.begin(), start.link_force.end(), f.begin());
                   });
  }

  int undine_send_free_velocity(undine_link* link, const double* v_free)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_send_free_velocity");
                     talk.send_free_velocity(vector(*link, v_free, "v_free"));
                   });
  }

  int undine_receive_link_force(undine_link* link, double* link_force)
  {
    return guarded(link,
                   [&]
                   {
                     auto& talk = conversation(link, "undine_receive_link_force");
                     talk.receive_link_force(vector(*link, link_force, "link_force"));
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
                     const auto position = vector(*link, x, "x"), velocity = vector(*link, v, "v");
                     talk.send_motion(
                         {.x = {position.begin(), position.end()}, .v = {velocity.begin(), velocity.end()}});
                   });
  }

  int undine_request_stop(undine_link* link, const char* reason)
  {
    return guarded(link,
                   [&]
                   {
                     conversation(link, "undine_request_stop")
                         .send_stop_request(reason != nullptr ? reason : "no reason given");
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
