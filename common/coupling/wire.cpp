// The bytes of the protocol: writers, readers, CRC, payloads.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/wire.hpp"

#include "common/coupling/exit_codes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>

namespace undine::link::wire
{
namespace
{

constexpr std::size_t crc_offset = 48;

constexpr std::array<std::uint32_t, 256> crc_table = []
{
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i)
  {
    std::uint32_t c = i;
    for (int bit = 0; bit < 8; ++bit)
      c = (c & 1u) != 0 ? (c >> 1) ^ 0x82F63B78u : c >> 1;
    table[i] = c;
  }
  return table;
}();

#if defined(__x86_64__)
__attribute__((target("sse4.2"))) std::uint32_t crc32c_by_instruction(std::span<const std::byte> bytes,
                                                                      std::uint32_t crc)
{
  std::uint64_t c = ~crc;
  const std::byte* p = bytes.data();
  std::size_t n = bytes.size();
  for (; n >= 8; n -= 8, p += 8)
  {
    std::uint64_t word;
    std::memcpy(&word, p, 8);
    c = __builtin_ia32_crc32di(c, word);
  }
  auto c32 = static_cast<std::uint32_t>(c);
  for (; n > 0; --n, ++p)
    c32 = __builtin_ia32_crc32qi(c32, static_cast<unsigned char>(*p));
  return ~c32;
}
#endif

std::string hex(std::uint32_t v)
{
  char text[16];
  std::snprintf(text, sizeof text, "0x%08X", static_cast<unsigned>(v));
  return text;
}

std::string size_text(std::size_t n) { return std::to_string(n); }

/// Position of an entry in words that a reader of the mesh understands.
std::string entry(const char* field, std::size_t i)
{
  return std::string(field) + "[" + std::to_string(i) + "]";
}

void require_size(const Reader& in, const char* field, std::size_t came, std::size_t expected,
                  const char* why)
{
  if (came != expected)
    in.reject(std::string("size of ") + field, size_text(came), size_text(expected) + " (" + why + ")");
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

} // namespace

std::uint32_t crc32c_by_table(std::span<const std::byte> bytes, std::uint32_t crc)
{
  std::uint32_t c = ~crc;
  for (const std::byte b : bytes)
    c = crc_table[(c ^ static_cast<std::uint32_t>(b)) & 0xFFu] ^ (c >> 8);
  return ~c;
}

std::uint32_t crc32c(std::span<const std::byte> bytes, std::uint32_t crc)
{
#if defined(__x86_64__)
  static const bool has_instruction = __builtin_cpu_supports("sse4.2");
  if (has_instruction)
    return crc32c_by_instruction(bytes, crc);
#endif
  return crc32c_by_table(bytes, crc);
}

std::size_t first_not_finite(std::span<const double> values)
{
  // NaN and infinity have all exponent bits set. Integer "or" is free of order, so this pass is vectorised;
  // the search runs only after a hit.
  constexpr std::uint64_t exponent = 0x7FF0000000000000u;
  std::uint64_t any = 0;
  for (const double x : values)
    any |= static_cast<std::uint64_t>((std::bit_cast<std::uint64_t>(x) & exponent) == exponent);
  if (any == 0)
    return values.size();
  const auto bad = std::find_if(values.begin(), values.end(), [](double x) { return !std::isfinite(x); });
  return static_cast<std::size_t>(bad - values.begin());
}

void Writer::bytes(const void* data, std::size_t size)
{
  if (size == 0)
    return;
  const std::size_t end = out_.size();
  out_.resize(end + size);
  std::memcpy(out_.data() + end, data, size);
}

void Writer::string(std::string_view s)
{
  if (s.size() > std::numeric_limits<std::uint32_t>::max())
    throw ProtocolError(code::internal_error, "a string of more than 4 GiB cannot be sent");
  u32(static_cast<std::uint32_t>(s.size()));
  bytes(s.data(), s.size());
}

void Writer::strings(std::span<const std::string> list)
{
  u64(list.size());
  for (const std::string& s : list)
    string(s);
}

void Reader::reject(const std::string& field, const std::string& came, const std::string& expected) const
{
  throw ProtocolError(code::message_out_of_order,
                      what_ + ": " + field + " is " + came + ", expected " + expected);
}

void Reader::bytes(const char* field, void* target, std::size_t size)
{
  if (size > rest_.size())
    throw ProtocolError(code::message_out_of_order, what_ + " is too short: " + size_text(rest_.size()) +
                                                        " bytes are left for " + field + ", expected " +
                                                        size_text(size));
  if (size > 0)
    std::memcpy(target, rest_.data(), size);
  rest_ = rest_.subspan(size);
}

double Reader::f64(const char* field)
{
  const auto v = number<double>(field);
  if (!std::isfinite(v))
    reject(field, std::to_string(v), "a finite number");
  return v;
}

bool Reader::boolean(const char* field)
{
  const std::uint8_t v = u8(field);
  if (v > 1)
    reject(field, std::to_string(v), "0 or 1");
  return v == 1;
}

std::size_t Reader::count(const char* field, std::size_t item_size)
{
  const std::uint64_t n = u64(field);
  if (n > rest_.size() / item_size)
    throw ProtocolError(code::message_out_of_order, what_ + " is too short: " + field + " announces " +
                                                        std::to_string(n) + " items, expected at most the " +
                                                        size_text(rest_.size() / item_size) + " that the " +
                                                        size_text(rest_.size()) + " bytes left can hold");
  return static_cast<std::size_t>(n);
}

std::string Reader::string(const char* field)
{
  const std::uint32_t n = u32(field);
  if (n > rest_.size())
    throw ProtocolError(code::message_out_of_order, what_ + " is too short: " + field + " announces " +
                                                        std::to_string(n) + " bytes, expected at most the " +
                                                        size_text(rest_.size()) + " that are left");
  std::string s(n, '\0');
  bytes(field, s.data(), n);
  return s;
}

std::vector<std::string> Reader::strings(const char* field)
{
  const std::size_t n = count(field, sizeof(std::uint32_t)); // an empty string takes four bytes
  std::vector<std::string> list;
  list.reserve(n);
  for (std::size_t i = 0; i < n; ++i)
    list.push_back(string(field));
  return list;
}

std::vector<double> Reader::f64_list(const char* field)
{
  std::vector<double> values = list<double>(field);
  const std::size_t bad = first_not_finite(values);
  if (bad < values.size())
    reject(entry(field, bad), std::to_string(values[bad]), "a finite number");
  return values;
}

void Reader::end()
{
  if (!rest_.empty())
    throw ProtocolError(code::message_out_of_order, what_ + " is too long: " + size_text(rest_.size()) +
                                                        " bytes are left after the last field, expected 0");
}

void begin(std::vector<std::byte>& out)
{
  out.clear();
  out.resize(header_size);
}

void seal(std::vector<std::byte>& out, Header header)
{
  header.payload_bytes = out.size() - header_size;
  std::byte* p = out.data();
  const auto put = [&p](const auto& value)
  {
    std::memcpy(p, &value, sizeof value);
    p += sizeof value;
  };
  put(magic);
  put(static_cast<std::uint16_t>(header.type));
  put(header.flags);
  put(header.sequence);
  put(header.window);
  put(header.t);
  put(header.dt);
  put(header.payload_bytes);
  std::memset(p, 0, header_size - crc_offset);
  const std::uint32_t crc = crc32c(out);
  put(crc);
}

Header open(std::span<const std::byte> message, const std::string& from,
            const std::function<std::string()>& expected)
{
  const auto reject = [&](const std::string& text)
  {
    throw ProtocolError(code::message_out_of_order,
                        "'" + from + "' sent " + text + "; expected " + expected());
  };

  if (message.size() < header_size)
    reject("a message of " + size_text(message.size()) + " bytes, which is less than the header's 64");

  const std::byte* p = message.data();
  const auto take = [&p](auto& value)
  {
    std::memcpy(&value, p, sizeof value);
    p += sizeof value;
  };
  std::uint32_t came_magic = 0;
  std::uint16_t type = 0;
  Header h;
  take(came_magic);
  take(type);
  take(h.flags);
  take(h.sequence);
  take(h.window);
  take(h.t);
  take(h.dt);
  take(h.payload_bytes);
  take(h.crc);
  h.type = static_cast<MessageType>(type);

  if (came_magic != magic)
    reject("a message that starts with " + hex(came_magic) + " instead of " + hex(magic));
  const auto name = [&h] { return std::string(name_of(h.type)) + " #" + std::to_string(h.sequence); };
  if (h.payload_bytes != message.size() - header_size)
    reject(name() + " with " + size_text(message.size() - header_size) +
           " payload bytes where its header announces " + std::to_string(h.payload_bytes));

  // The CRC field counts as zero; header and payload are covered without a copy of the payload.
  std::array<std::byte, header_size> head;
  std::memcpy(head.data(), message.data(), header_size);
  std::memset(head.data() + crc_offset, 0, sizeof(std::uint32_t));
  const std::uint32_t crc = crc32c(message.subspan(header_size), crc32c(head));
  if (crc != h.crc)
    reject(name() + " with checksum " + hex(h.crc) + " where its bytes give " + hex(crc) + " (corrupt)");
  if (!std::isfinite(h.t) || !std::isfinite(h.dt))
    reject(name() + " with t = " + std::to_string(h.t) + ", dt = " + std::to_string(h.dt) + " (not finite)");
  return h;
}

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
  m.x = in.f64_list("x");
  m.v = in.f64_list("v");
  in.end();
  require_size(in, "x", m.x.size(), size, "nodes x dim of the MESH");
  require_size(in, "v", m.v.size(), size, "nodes x dim of the MESH");
  return m;
}

Kinematics read_kinematics(Reader in, std::size_t size)
{
  Kinematics k;
  k.v = in.f64_list("v");
  k.a_free = in.f64_list("a_free");
  in.end();
  require_size(in, "v", k.v.size(), size, "nodes x dim of the MESH");
  require_size(in, "a_free", k.a_free.size(), size, "nodes x dim of the MESH");
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
  a.impulse = in.f64_list("impulse");
  a.link_force = in.f64_list("link_force");
  in.end();
  require_size(in, "impulse", a.impulse.size(), size, "nodes x dim of the MESH");
  require_size(in, "link_force", a.link_force.size(), size, "nodes x dim of the MESH");
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
