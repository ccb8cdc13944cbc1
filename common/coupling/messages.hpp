// What the three programs say to each other, independent of how the bytes travel.
// SPDX-License-Identifier: BSD-3-Clause
//
// One participant (a fluid or a solid) talks to the coupler only. All vectors belong to the participant's
// *wet surface*: the union of all its interface faces, each node once, in the order of its MESH message; rows
// of `dim` numbers.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace undine::link
{

/// Message types. Numbers are part of the protocol and never reused. Reserved ones are not sent by
/// protocol 1.0.
enum class MessageType : std::uint16_t
{
  setup = 1,            ///< C→P  scheme, interfaces, run window
  mesh = 2,             ///< P→C  wet surface
  mesh_reply = 3,       ///< C→P  accepted, or the reason why not
  ready = 4,            ///< P→C  state at a window end: stable step, energies (see Report)
  window = 5,           ///< C→P  the next window (see Window)
  free_velocity = 6,    ///< P→C  v_free on the wet surface at a synchronised time [m/s]
  link_force = 7,       ///< C→P  nodal link force [N]
  mesh_update = 8,      ///< P→C  replaces MESH when the wet surface changed
  checkpoint = 9,       ///< C→P  write your state, between two windows
  checkpoint_done = 10, ///< P→C  written, or the reason why not
  stop_request = 11,    ///< P→C  please end after this window
  bye = 12,             ///< C→P  orderly end
  bye_ack = 13,         ///< P→C
  fail = 14,            ///< any  code and text
  ping = 15,            ///< any  alive, still working
  kinematics = 16, ///< P→C  velocity and free acceleration at a synchronised time, asked for by an activation
  activation_impulse = 17, ///< C→P  impulse and link force that make the start compatible
  surface = 18,            ///< C→P  the partner's wet surface, for contact and remeshing beside it
  motion = 19              ///< P→C  positions and velocities of a participant at level A
};

const char* name_of(MessageType);

/// Wet surface of a participant.
struct SurfaceMesh
{
  int dim = 2;
  std::uint32_t epoch = 0;             ///< counts changes of the surface
  std::vector<std::string> interfaces; ///< names; face_interface indexes them
  std::vector<std::int64_t> node_id;   ///< global, unique, size n
  std::vector<double> x;               ///< current position [m], n × dim
  /// Symmetric matrix per node [1/kg], n × dim × dim; zero in constrained directions.
  std::vector<double> inverse_mass;
  std::vector<std::int32_t> face_offset{0}; ///< CSR, size n_faces + 1
  /// Positions in node_id, outward orientation of the participant's body.
  std::vector<std::int32_t> face_nodes;
  std::vector<std::int32_t> face_interface; ///< size n_faces
  /// Pairs of different nodes that a force on one of them moves both (the two faces of a thin wall):
  /// positions in node_id, 2 per pair, each pair once. Usually empty.
  std::vector<std::int32_t> coupled_nodes;
  /// Acceleration of the first node per force on the second [1/kg], pairs × dim × dim; the reverse is its
  /// transpose.
  std::vector<double> coupled_inverse_mass;
  /// Rank of the participant that sends and receives each row of the vectors, size n; empty: all are rank
  /// 0's.
  std::vector<std::int32_t> owner;

  std::int64_t n_nodes() const { return static_cast<std::int64_t>(node_id.size()); }
  std::int64_t n_faces() const { return static_cast<std::int64_t>(face_offset.size()) - 1; }
  /// Positions in node_id of the rows of `rank`, ascending: the order of its vectors.
  std::vector<std::int64_t> rows_of(int rank) const;
};

/// State of a participant at a window end.
struct Report
{
  double stable_dt = 0.0;       ///< largest step it can take next, safety factor included [s]
  double kinetic_energy = 0.0;  ///< [J]
  double internal_energy = 0.0; ///< [J]
  /// Cumulated work of loads and prescribed motion, gravity's potential included [J].
  double external_work = 0.0;
  double dissipated_energy = 0.0; ///< cumulated [J]
  double interface_work = 0.0;    ///< cumulated work of the link forces as seen by the participant [J]
  double mass = 0.0;              ///< [kg]
  double compute_seconds = 0.0;   ///< wall time spent computing since start
  double wait_seconds = 0.0;      ///< wall time spent waiting for the coupler since start
  std::int64_t steps = 0;         ///< cumulated
  bool surface_changed = false;   ///< a MESH_UPDATE follows
};

/// Orders for one window.
struct Window
{
  std::int64_t index = 0;
  double t_begin = 0.0;   ///< [s]
  double t_end = 0.0;     ///< [s]
  std::int64_t steps = 1; ///< equal steps this participant takes inside the window
  bool fine = false;      ///< true: exchange every step; false: once, with the last multiplier
  bool activate = false;  ///< KINEMATICS / ACTIVATION_IMPULSE precede the first step
  bool output = false;    ///< write a frame at t_end
  bool last = false;      ///< the run ends at t_end
  /// At t_end the participant reports and goes back to the state it had when this order came; nothing is
  /// written. For participants that offer capability::rewind.
  bool trial = false;
  /// Nothing can touch: no exchange in the steps; after the last one FREE_VELOCITY is the mean velocity of
  /// the wet nodes over the window, and no LINK_FORCE comes. With the contact schemes, for participants that
  /// offer capability::flight.
  bool flight = false;

  double dt() const { return (t_end - t_begin) / static_cast<double>(steps); }
};

/// Set-up of the coupling as the coupler read it from the case.
struct Setup
{
  int dim = 2;
  double t_begin = 0.0, t_end = 0.0; ///< [s]
  /// "gc": the participant is asked for free velocities (level B); "staggered": it is given forces (level A);
  /// "contact" and "contact+surface": level B with the exchange in the middle of the step, where contact
  /// opens and closes: the free velocity is v^{n−1/2} + Δt a^n, and the link force acts as v ← v + Δt M⁻¹f
  /// before the positions move. With "+surface" the participant is shown its partner's wet surface before
  /// each MESH and MESH_UPDATE.
  std::string scheme = "gc";
  std::vector<std::string> interfaces;
  /// Folder of the checkpoint to continue from; empty: the run begins at t_begin.
  std::string restart;
};

/// Order to write the state into a folder.
struct CheckpointOrder
{
  std::string folder;       ///< exists; shared by all participants
  std::string id;           ///< name of the checkpoint
  std::int64_t windows = 0; ///< so far
  double t = 0.0;           ///< [s]
};

/// Answer to a CheckpointOrder.
struct CheckpointDone
{
  bool written = false;
  std::string reason;             ///< why not
  std::vector<std::string> files; ///< names in the folder, complete and closed
};

inline constexpr const char* staggered_scheme = "staggered"; ///< Setup::scheme of a participant at level A
inline constexpr const char* contact_scheme = "contact"; ///< … at level B, exchange in the middle of the step
inline constexpr const char* contact_surface_scheme =
    "contact+surface"; ///< … that also needs the partner's surface

/// Answer to the request for kinematics.
struct Kinematics
{
  std::vector<double> v;      ///< velocity [m/s], n × dim
  std::vector<double> a_free; ///< M⁻¹F without link force [m/s²], n × dim
};

/// State of a participant at level A.
struct Motion
{
  std::vector<double> x; ///< position [m], n × dim
  std::vector<double> v; ///< velocity [m/s], n × dim
};

struct Activation
{
  std::vector<double> impulse;    ///< [N s], n × dim: v ← v + M⁻¹ impulse
  std::vector<double> link_force; ///< [N], n × dim: a ← a_free + M⁻¹ link_force
};

} // namespace undine::link
