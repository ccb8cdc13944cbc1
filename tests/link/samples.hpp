// One content of every message type, the same as in golden_messages.py, and tools to make and break messages.
#pragma once

#include "common/coupling/wire.hpp"

#include <catch2/catch.hpp>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace samples
{

using namespace undine::link;
using Bytes = std::vector<std::byte>;

inline Setup setup()
{
  return {.dim = 2, .t_begin = 0.5, .t_end = 1.5, .scheme = "gc", .interfaces = {"gate", "bed"}};
}

inline SurfaceMesh mesh()
{
  return {.dim = 2,
          .epoch = 3,
          .interfaces = {"gate", "bed"},
          .node_id = {11, 7, std::int64_t(1) << 40},
          .x = {0.0, 1.0, 0.5, 1.5, 1.0, 2.0},
          .inverse_mass = {1.0, 0.0, 0.0, 1.0, 2.0, 0.5, 0.5, 2.0, 0.0, 0.0, 0.0, 4.0},
          .face_offset = {0, 2, 4},
          .face_nodes = {0, 1, 1, 2},
          .face_interface = {0, 1}};
}

/// Its first and last node are on the two faces of a thin wall.
inline SurfaceMesh thin_wall()
{
  SurfaceMesh wall = mesh();
  wall.coupled_nodes = {0, 2};
  wall.coupled_inverse_mass = {0.5, 0.25, -0.25, 0.125};
  return wall;
}

/// Its rows belong to three ranks.
inline SurfaceMesh of_several_ranks()
{
  SurfaceMesh m = mesh();
  m.owner = {1, 0, 2};
  return m;
}

inline wire::MeshReply mesh_reply() { return {.accepted = false, .reason = "gap of 2 mm"}; }

inline Report report()
{
  return {.stable_dt = 1e-4,
          .kinetic_energy = 1,
          .internal_energy = 2,
          .external_work = 3,
          .dissipated_energy = 4,
          .interface_work = 5,
          .mass = 6,
          .compute_seconds = 7,
          .wait_seconds = 8,
          .steps = 9,
          .surface_changed = true};
}

inline Window window()
{
  return {.index = 41, .t_begin = 0.25, .t_end = 0.5, .steps = 7, .fine = true, .output = true};
}

inline Window window_on_trial()
{
  Window w = window();
  w.trial = true;
  return w;
}

inline Window window_in_flight()
{
  Window w = window();
  w.flight = true;
  return w;
}

inline std::vector<double> vector() { return {0.0, -1.0, 2.5, 1e-300, 1e300, -0.0}; }
inline Kinematics kinematics() { return {.v = {1.0, 2.0}, .a_free = {3.0, 4.0}}; }
inline Activation activation() { return {.impulse = {5.0, 6.0}, .link_force = {7.0, 8.0}}; }
inline Motion motion() { return {.x = {0.5, 0.25}, .v = {3.0, 4.0}}; }
inline CheckpointOrder checkpoint_order()
{
  return {.folder = "out/checkpoints/000007", .id = "000007", .windows = 41, .t = 0.25};
}
inline CheckpointDone checkpoint_done()
{
  return {.written = false, .reason = "disk full", .files = {"solid.h5"}};
}
inline wire::Failed failed() { return {.code = 10, .text = "element 17 is inverted"}; }

/// A sealed message with whatever `fill(Writer&)` writes.
template <class Fill>
Bytes message(wire::Header header, Fill&& fill)
{
  Bytes bytes;
  wire::begin(bytes);
  wire::Writer out(bytes);
  fill(out);
  wire::seal(bytes, header);
  return bytes;
}

template <class Content>
Bytes message_of(wire::Header header, const Content& content)
{
  return message(header, [&](wire::Writer& out) { wire::write(out, content); });
}

/// Payload of some content, without a header.
template <class Content>
Bytes payload_of(const Content& content)
{
  Bytes bytes;
  wire::Writer out(bytes);
  wire::write(out, content);
  return bytes;
}

inline std::string hex(const Bytes& bytes)
{
  static const char* digits = "0123456789abcdef";
  std::string text;
  for (const std::byte b : bytes)
  {
    text += digits[static_cast<unsigned>(b) >> 4];
    text += digits[static_cast<unsigned>(b) & 15u];
  }
  return text;
}

/// Code and text of the ProtocolError that `action` must throw.
template <class Action>
ProtocolError error_of(Action&& action)
{
  try
  {
    action();
  }
  catch (const ProtocolError& error)
  {
    return error;
  }
  return ProtocolError(0, "nothing was thrown");
}

inline bool mentions(const ProtocolError& error, std::initializer_list<const char*> words)
{
  for (const char* word : words)
    if (std::string(error.what()).find(word) == std::string::npos)
    {
      UNSCOPED_INFO("'" << error.what() << "' does not mention '" << word << "'");
      return false;
    }
  return true;
}

} // namespace samples
