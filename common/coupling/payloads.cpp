// The payload of each message type, and what its content must keep.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/text.hpp"
#include "common/coupling/wire.hpp"

#include <algorithm>
#include <string_view>

namespace undine::link::wire
{
namespace
{

void require_size(const Reader& in, const char* field, std::size_t came, std::size_t expected,
                  const char* why)
{
  if (came != expected)
    in.reject(std::string("size of ") + field, std::to_string(came),
              std::to_string(expected) + " (" + why + ")");
}

void require_faces(const Reader& in, const SurfaceMesh& mesh)
{
  if (mesh.face_offset.empty() || mesh.face_offset.front() != 0)
    in.reject("face_offset", mesh.face_offset.empty() ? "empty" : "starting with another number", "0 first");
  const auto least = mesh.dim; // 2 nodes of an edge, 3 of a facet
  for (std::size_t f = 0; f + 1 < mesh.face_offset.size(); ++f)
    if (std::int64_t(mesh.face_offset[f + 1]) - mesh.face_offset[f] < least)
      in.reject(entry("face_offset", f + 1), std::to_string(mesh.face_offset[f + 1]),
                "at least " + std::to_string(mesh.face_offset[f]) + " + " + std::to_string(least) + " nodes");
  require_size(in, "face_nodes", mesh.face_nodes.size(), static_cast<std::size_t>(mesh.face_offset.back()),
               "last face_offset");
  require_size(in, "face_interface", mesh.face_interface.size(), mesh.face_offset.size() - 1,
               "number of faces");
  for (std::size_t i = 0; i < mesh.face_nodes.size(); ++i)
    if (mesh.face_nodes[i] < 0 || mesh.face_nodes[i] >= mesh.n_nodes())
      in.reject(entry("face_nodes", i), std::to_string(mesh.face_nodes[i]),
                "a position in 0.." + std::to_string(mesh.n_nodes() - 1));
  for (std::size_t f = 0; f < mesh.face_interface.size(); ++f)
    if (mesh.face_interface[f] < 0 || mesh.face_interface[f] >= std::int64_t(mesh.interfaces.size()))
      in.reject(entry("face_interface", f), std::to_string(mesh.face_interface[f]),
                "one of " + std::to_string(mesh.interfaces.size()) + " interfaces");
}

void require_pairs(const Reader& in, const SurfaceMesh& mesh)
{
  const auto dim = static_cast<std::size_t>(mesh.dim), pairs = mesh.coupled_nodes.size() / 2;
  require_size(in, "coupled_nodes", mesh.coupled_nodes.size(), 2 * pairs, "two per pair");
  require_size(in, "coupled_inverse_mass", mesh.coupled_inverse_mass.size(), pairs * dim * dim,
               "pairs x dim x dim");
  for (std::size_t i = 0; i < mesh.coupled_nodes.size(); ++i)
    if (const auto k = mesh.coupled_nodes[i];
        k < 0 || k >= mesh.n_nodes() || (i % 2 == 1 && k == mesh.coupled_nodes[i - 1]))
      in.reject(entry("coupled_nodes", i), std::to_string(k),
                "a position in 0.." + std::to_string(mesh.n_nodes() - 1) + ", two different ones per pair");
}

void require_owners(const Reader& in, const SurfaceMesh& mesh)
{
  require_size(in, "owner", mesh.owner.size(), mesh.node_id.size(), "nodes");
  for (std::size_t i = 0; i < mesh.owner.size(); ++i)
    if (mesh.owner[i] < 0)
      in.reject(entry("owner", i), std::to_string(mesh.owner[i]), "a rank of the participant");
}

void require_unique_ids(const Reader& in, const SurfaceMesh& mesh)
{
  std::vector<std::int64_t> ids = mesh.node_id;
  std::sort(ids.begin(), ids.end());
  const auto twin = std::adjacent_find(ids.begin(), ids.end());
  if (twin != ids.end())
    in.reject("node_id", std::to_string(*twin) + " twice", "each node once");
}

void require_positive(const Reader& in, const char* field, double value)
{
  if (!(value > 0.0))
    in.reject(field, std::to_string(value), "a positive number");
}

/// A payload of two vectors of the wet surface.
void read_both(Reader& in, std::size_t size, const char* name, std::vector<double>& one,
               const char* name_of_other, std::vector<double>& other)
{
  one = in.f64_list(name);
  other = in.f64_list(name_of_other);
  in.end();
  require_size(in, name, one.size(), size, "nodes x dim of the MESH");
  require_size(in, name_of_other, other.size(), size, "nodes x dim of the MESH");
}

} // namespace

void write(Writer& out, const Setup& s)
{
  out.i32(s.dim);
  out.f64(s.t_begin);
  out.f64(s.t_end);
  out.string(s.scheme);
  out.strings(s.interfaces);
  out.string(s.restart);
}

Setup read_setup(Reader in)
{
  Setup s;
  s.dim = in.i32("dim");
  if (s.dim != 2 && s.dim != 3)
    in.reject("dim", std::to_string(s.dim), "2 or 3");
  s.t_begin = in.f64("t_begin");
  s.t_end = in.f64("t_end");
  s.scheme = in.string("scheme");
  s.interfaces = in.strings("interfaces");
  s.restart = in.string("restart");
  in.end();
  return s;
}

void write(Writer& out, const SurfaceMesh& m)
{
  out.i32(m.dim);
  out.u32(m.epoch);
  out.strings(m.interfaces);
  out.list<std::int64_t>(m.node_id);
  out.list<double>(m.x);
  out.list<double>(m.inverse_mass);
  out.list<std::int32_t>(m.face_offset);
  out.list<std::int32_t>(m.face_nodes);
  out.list<std::int32_t>(m.face_interface);
  if (m.coupled_nodes.empty() && m.owner.empty()) // as version 1.0 had it
    return;
  out.list<std::int32_t>(m.coupled_nodes);
  out.list<double>(m.coupled_inverse_mass);
  if (!m.owner.empty())
    out.list<std::int32_t>(m.owner);
}

SurfaceMesh read_surface_mesh(Reader in)
{
  SurfaceMesh m;
  m.dim = in.i32("dim");
  if (m.dim != 2 && m.dim != 3)
    in.reject("dim", std::to_string(m.dim), "2 or 3");
  m.epoch = in.u32("epoch");
  m.interfaces = in.strings("interfaces");
  m.node_id = in.i64_list("node_id");
  m.x = in.f64_list("x");
  m.inverse_mass = in.f64_list("inverse_mass");
  m.face_offset = in.i32_list("face_offset");
  m.face_nodes = in.i32_list("face_nodes");
  m.face_interface = in.i32_list("face_interface");
  if (in.left() >= 16) // two more lists
  {
    m.coupled_nodes = in.i32_list("coupled_nodes");
    m.coupled_inverse_mass = in.f64_list("coupled_inverse_mass");
    if (in.left() > 0)
    {
      m.owner = in.i32_list("owner");
      if (m.owner.empty()) // one way to say one thing
        in.reject("owner", "an empty list", "left out where all rows are rank 0's");
    }
    else if (m.coupled_nodes.empty())
      in.reject("coupled_nodes", "an empty list",
                "left out with coupled_inverse_mass where no nodes are coupled");
  }
  in.end();

  const std::size_t n = m.node_id.size();
  const auto dim = static_cast<std::size_t>(m.dim);
  require_size(in, "x", m.x.size(), n * dim, "nodes x dim");
  require_size(in, "inverse_mass", m.inverse_mass.size(), n * dim * dim, "nodes x dim x dim");
  require_faces(in, m);
  require_pairs(in, m);
  if (!m.owner.empty())
    require_owners(in, m);
  require_unique_ids(in, m);
  return m;
}

void write(Writer& out, const MeshReply& r)
{
  out.u8(r.accepted ? 1 : 0);
  out.string(r.reason);
}

MeshReply read_mesh_reply(Reader in)
{
  MeshReply r;
  r.accepted = in.boolean("accepted");
  r.reason = in.string("reason");
  in.end();
  return r;
}

void write(Writer& out, const Report& r)
{
  out.f64(r.stable_dt);
  out.f64(r.kinetic_energy);
  out.f64(r.internal_energy);
  out.f64(r.external_work);
  out.f64(r.dissipated_energy);
  out.f64(r.interface_work);
  out.f64(r.mass);
  out.f64(r.compute_seconds);
  out.f64(r.wait_seconds);
  out.i64(r.steps);
  out.u8(r.surface_changed ? 1 : 0);
}

Report read_report(Reader in)
{
  Report r;
  r.stable_dt = in.f64("stable_dt");
  r.kinetic_energy = in.f64("kinetic_energy");
  r.internal_energy = in.f64("internal_energy");
  r.external_work = in.f64("external_work");
  r.dissipated_energy = in.f64("dissipated_energy");
  r.interface_work = in.f64("interface_work");
  r.mass = in.f64("mass");
  r.compute_seconds = in.f64("compute_seconds");
  r.wait_seconds = in.f64("wait_seconds");
  r.steps = in.i64("steps");
  r.surface_changed = in.boolean("surface_changed");
  in.end();
  require_positive(in, "stable_dt", r.stable_dt);
  return r;
}

void write(Writer& out, const Window& w)
{
  out.i64(w.index);
  out.f64(w.t_begin);
  out.f64(w.t_end);
  out.i64(w.steps);
  out.u8(static_cast<std::uint8_t>((w.fine ? 1 : 0) | (w.trial ? 2 : 0) | (w.flight ? 4 : 0)));
  out.u8(w.activate ? 1 : 0);
  out.u8(w.output ? 1 : 0);
  out.u8(w.last ? 1 : 0);
}

Window read_window(Reader in)
{
  Window w;
  w.index = in.i64("index");
  w.t_begin = in.f64("t_begin");
  w.t_end = in.f64("t_end");
  w.steps = in.i64("steps");
  const std::uint8_t exchange = in.u8("fine");
  if (exchange > 7)
    in.reject("fine", std::to_string(exchange), "0 to 7");
  w.fine = (exchange & 1) != 0;
  w.trial = (exchange & 2) != 0;
  w.flight = (exchange & 4) != 0;
  w.activate = in.boolean("activate");
  w.output = in.boolean("output");
  w.last = in.boolean("last");
  in.end();
  if (w.steps < 1)
    in.reject("steps", std::to_string(w.steps), "at least 1");
  if (!(w.t_end > w.t_begin))
    in.reject("t_end", std::to_string(w.t_end), "later than t_begin = " + std::to_string(w.t_begin));
  return w;
}

void write(Writer& out, const CheckpointOrder& c)
{
  out.string(c.folder);
  out.string(c.id);
  out.i64(c.windows);
  out.f64(c.t);
}

CheckpointOrder read_checkpoint_order(Reader in)
{
  CheckpointOrder c;
  c.folder = in.string("folder");
  c.id = in.string("id");
  c.windows = in.i64("windows");
  c.t = in.f64("t");
  in.end();
  return c;
}

void write(Writer& out, const CheckpointDone& c)
{
  out.u8(c.written);
  out.string(c.reason);
  out.strings(c.files);
}

CheckpointDone read_checkpoint_done(Reader in)
{
  CheckpointDone c;
  c.written = in.boolean("written");
  c.reason = in.string("reason");
  c.files = in.strings("files");
  in.end();
  return c;
}

void write(Writer& out, const Motion& m)
{
  out.list<double>(m.x);
  out.list<double>(m.v);
}

void write(Writer& out, const Kinematics& k)
{
  out.list<double>(k.v);
  out.list<double>(k.a_free);
}

Motion read_motion(Reader in, std::size_t size)
{
  Motion m;
  read_both(in, size, "x", m.x, "v", m.v);
  return m;
}

Kinematics read_kinematics(Reader in, std::size_t size)
{
  Kinematics k;
  read_both(in, size, "v", k.v, "a_free", k.a_free);
  return k;
}

void write(Writer& out, const Activation& a)
{
  out.list<double>(a.impulse);
  out.list<double>(a.link_force);
}

Activation read_activation(Reader in, std::size_t size)
{
  Activation a;
  read_both(in, size, "impulse", a.impulse, "link_force", a.link_force);
  return a;
}

void write(Writer& out, const Failed& f)
{
  out.i32(f.code);
  std::size_t n = std::min(f.text.size(), longest_failure_text);
  // Not in the middle of a UTF-8 character: its continuation bytes are 10xxxxxx.
  while (n > 0 && n < f.text.size() && (static_cast<unsigned char>(f.text[n]) & 0xC0u) == 0x80u)
    --n;
  out.string(std::string_view(f.text).substr(0, n));
}

Failed read_failed(Reader in)
{
  Failed f;
  f.code = in.i32("code");
  f.text = in.string("text");
  in.end();
  return f;
}

void write(Writer& out, const std::string& reason) { out.string(reason); }

std::string read_reason(Reader in)
{
  std::string reason = in.string("reason");
  in.end();
  return reason;
}

} // namespace undine::link::wire
