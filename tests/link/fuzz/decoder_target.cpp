// Fuzz target: whatever bytes come, the decoders and the solver's end of the link refuse them with a
// ProtocolError or take them whole.
//
// First byte: which decoder. 0 to 11: a payload; what is accepted must be written back as the same bytes. 12
// to 14: HELLO, ROSTER, a message with its header. 15: a conversation, a list of (type, length, payload)
// sealed with right numbers and checksums. 16: the coupler's end of one, with a participant on several ranks:
// u16 length of what rank 0 says, the same list, then what every other owner of rows says.
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/handshake.hpp"
#include "common/coupling/link.hpp"
#include "common/coupling/wire.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>

namespace
{

using namespace undine::link;
using Bytes = std::vector<std::byte>;

[[noreturn]] void broken(const char* claim)
{
  std::fprintf(stderr, "fuzz: %s\n", claim);
  std::abort();
}

/// Decodes, encodes, compares.
template <class Read, class Write>
void round_trip(std::span<const std::byte> payload, Read&& read, Write&& write)
{
  const auto content = read(wire::Reader(payload, "fuzz"));
  Bytes again;
  wire::Writer writer(again);
  write(writer, content);
  if (again.size() != payload.size() || !std::equal(again.begin(), again.end(), payload.begin()))
    broken("an accepted payload is not written back as it came");
}

template <class Read>
void round_trip(std::span<const std::byte> payload, Read&& read)
{
  round_trip(payload, read, [](wire::Writer& out, const auto& content) { wire::write(out, content); });
}

/// Hands out prepared messages; then the partner is gone.
class ScriptedChannel final : public Channel
{
public:
  explicit ScriptedChannel(std::deque<Bytes> messages) : messages_(std::move(messages)) {}
  void send(std::span<const std::byte>) override {}
  void receive(Bytes& message) override
  {
    if (messages_.empty())
      throw ProtocolError(code::partner_silent, "the script is over");
    message = std::move(messages_.front());
    messages_.pop_front();
  }

private:
  std::deque<Bytes> messages_;
};

std::deque<Bytes> sealed_messages(std::span<const std::byte> bytes)
{
  std::deque<Bytes> messages;
  std::int64_t window = -1;
  while (bytes.size() >= 3 && messages.size() < 64)
  {
    const auto type = static_cast<MessageType>(bytes[0]);
    const std::size_t length = std::min<std::size_t>(
        static_cast<std::size_t>(bytes[1]) | static_cast<std::size_t>(bytes[2]) << 8, bytes.size() - 3);
    const auto payload = bytes.subspan(3, length);
    if (type == MessageType::window && length >= sizeof window)
      std::memcpy(&window, payload.data(), sizeof window);
    if (type == MessageType::kinematics) // of a participant, whose windows all begin with it
      ++window;
    Bytes message;
    wire::begin(message);
    message.insert(message.end(), payload.begin(), payload.end());
    wire::seal(message, wire::Header{.type = type, .sequence = messages.size() + 1, .window = window});
    messages.push_back(std::move(message));
    bytes = bytes.subspan(3 + length);
  }
  return messages;
}

/// A solver with one edge that does what it is told.
void converse(std::deque<Bytes> messages)
{
  SolverLink link(std::make_unique<ScriptedChannel>(std::move(messages)));
  const Setup setup = link.receive_setup();
  const auto dim = static_cast<std::size_t>(setup.dim);
  SurfaceMesh mesh{.dim = setup.dim, .interfaces = {"a"}, .node_id = {0, 1, 2}};
  mesh.x.assign(3 * dim, 0.0);
  mesh.inverse_mass.assign(3 * dim * dim, 0.0);
  mesh.face_offset = {0, static_cast<std::int32_t>(dim)};
  for (std::size_t k = 0; k < dim; ++k)
    mesh.face_nodes.push_back(static_cast<std::int32_t>(k));
  mesh.face_interface = {0};
  link.send_mesh(mesh);
  std::vector<double> v(3 * dim, 0.0);
  const Report report{.stable_dt = 1.0};
  link.send_report(report);
  while (const auto window = link.next_window())
  {
    if (window->activate)
    {
      link.send_kinematics({.v = v, .a_free = v});
      if (link.receive_activation().impulse.size() != v.size())
        broken("an activation of another size was accepted");
    }
    for (std::int64_t j = 0; j < (window->fine && !window->flight ? window->steps : 1); ++j)
    {
      link.send_free_velocity(v);
      if (!window->flight)
        link.receive_link_force(v);
    }
    link.send_report(report);
  }
}

/// A coupler that gives back what comes, for three windows.
void converse_as_coupler(std::span<const std::byte> bytes)
{
  if (bytes.size() < 2)
    return;
  const std::size_t first = std::min<std::size_t>(
      static_cast<std::size_t>(bytes[0]) | static_cast<std::size_t>(bytes[1]) << 8, bytes.size() - 2);
  const auto of_owners = bytes.subspan(2 + first);
  PartnerLink link(std::make_unique<ScriptedChannel>(sealed_messages(bytes.subspan(2, first))), "solid",
                   [of_owners](int)
                   { return std::make_unique<ScriptedChannel>(sealed_messages(of_owners)); });
  link.send_setup({.dim = 2, .t_begin = 0.0, .t_end = 3.0, .interfaces = {"a"}});
  std::size_t size = link.receive_mesh().x.size();
  link.accept_mesh();
  bool changed = link.receive_report().surface_changed;
  for (std::int64_t k = 0; k < 3; ++k)
  {
    if (changed)
      size = link.receive_mesh_update().x.size();
    const auto t = static_cast<double>(k);
    link.send_window({.index = k, .t_begin = t, .t_end = t + 1.0, .fine = true, .activate = true});
    const Kinematics state = link.receive_kinematics();
    if (state.v.size() != size || state.a_free.size() != size)
      broken("kinematics of another size were accepted");
    link.send_activation({.impulse = state.v, .link_force = state.a_free});
    std::vector<double> v(size);
    link.receive_free_velocity(v);
    link.send_link_force(v);
    changed = link.receive_report().surface_changed;
  }
  link.send_bye();
}

void feed(std::uint8_t which, std::span<const std::byte> bytes)
{
  const auto number = [](wire::Writer& out, const std::string& text) { out.string(text); };
  switch (which % 17)
  {
  case 0:
    return round_trip(bytes, wire::read_setup);
  case 1:
    return round_trip(bytes, wire::read_surface_mesh);
  case 2:
    return round_trip(bytes, [](wire::Reader in) { return wire::read_motion(std::move(in), 2); });
  case 3:
    return round_trip(bytes, wire::read_mesh_reply);
  case 4:
    return round_trip(bytes, wire::read_report);
  case 5:
    return round_trip(bytes, wire::read_window);
  case 6:
    return round_trip(bytes, wire::read_checkpoint_order);
  case 7:
    return round_trip(bytes, [](wire::Reader in) { return wire::read_kinematics(std::move(in), 2); });
  case 8:
    return round_trip(bytes, wire::read_checkpoint_done);
  case 9:
    return round_trip(bytes, [](wire::Reader in) { return wire::read_activation(std::move(in), 2); });
  case 10:
    return round_trip(bytes, wire::read_failed);
  case 11:
    return round_trip(bytes, wire::read_reason, number);
  case 12:
    decode_hello(bytes);
    return;
  case 13:
    decode_roster(bytes);
    return;
  case 14:
    wire::open(bytes, "fuzz", [] { return std::string("anything"); });
    return;
  case 16:
    return converse_as_coupler(bytes);
  default:
    return converse(sealed_messages(bytes));
  }
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
  if (size == 0)
    return 0;
  try
  {
    feed(data[0], std::as_bytes(std::span(data + 1, size - 1)));
  }
  catch (const ProtocolError& error)
  {
    if (error.code() < 1 || error.code() > 40)
      broken("an error with a code that is not documented");
  }
  return 0; // any other exception ends the program
}
