// The bytes of every message: compared with an independent packer, read back, damaged.
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/handshake.hpp"
#include "common/coupling/wire.hpp"
#include "common/error.hpp"

#include "tests/link/samples.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cstring>
#include <functional>
#include <random>

using namespace samples;

namespace golden
{
#include "tests/link/golden_messages.inc"
}

namespace
{

wire::Header header(MessageType type)
{
  return {.type = type, .sequence = 5, .window = 41, .t = 0.25, .dt = 0.125};
}

Bytes vector_message(MessageType type)
{
  const std::vector<double> v = vector();
  return message(header(type), [&](wire::Writer& out) { out.bytes(v.data(), v.size() * sizeof(double)); });
}

Bytes reason_message(MessageType type, const char* reason)
{
  return message(header(type), [&](wire::Writer& out) { out.string(reason); });
}

Bytes empty_message(MessageType type)
{
  return message(header(type), [](wire::Writer&) {});
}

std::string nothing_special() { return "WINDOW"; }

/// Every reader of a payload with structure.
std::vector<std::pair<const char*, std::function<void(std::span<const std::byte>)>>> readers()
{
  const auto reader = [](std::span<const std::byte> bytes) { return wire::Reader(bytes, "the message"); };
  return {{"setup", [=](auto bytes) { wire::read_setup(reader(bytes)); }},
          {"mesh", [=](auto bytes) { wire::read_surface_mesh(reader(bytes)); }},
          {"mesh_reply", [=](auto bytes) { wire::read_mesh_reply(reader(bytes)); }},
          {"ready", [=](auto bytes) { wire::read_report(reader(bytes)); }},
          {"window", [=](auto bytes) { wire::read_window(reader(bytes)); }},
          {"kinematics", [=](auto bytes) { wire::read_kinematics(reader(bytes), 2); }},
          {"activation", [=](auto bytes) { wire::read_activation(reader(bytes), 2); }},
          {"checkpoint", [=](auto bytes) { wire::read_checkpoint_order(reader(bytes)); }},
          {"checkpoint_done", [=](auto bytes) { wire::read_checkpoint_done(reader(bytes)); }},
          {"fail", [=](auto bytes) { wire::read_failed(reader(bytes)); }},
          {"reason", [=](auto bytes) { wire::read_reason(reader(bytes)); }},
          {"motion", [=](auto bytes) { wire::read_motion(reader(bytes), 2); }}};
}

std::vector<Bytes> payloads()
{
  Bytes reason;
  wire::Writer(reason).string("SIGTERM");
  return {payload_of(setup()),
          payload_of(mesh()),
          payload_of(mesh_reply()),
          payload_of(report()),
          payload_of(window()),
          payload_of(kinematics()),
          payload_of(activation()),
          payload_of(checkpoint_order()),
          payload_of(checkpoint_done()),
          payload_of(failed()),
          reason,
          payload_of(motion())};
}

} // namespace

TEST_CASE("exit codes of the library are those of the programs", "[link][unit]")
{
  using undine::ExitCode;
  CHECK(code::internal_error == int(ExitCode::internal_error));
  CHECK(code::bad_input_file == int(ExitCode::bad_input_file));
  CHECK(code::mpi_start_incomplete == int(ExitCode::mpi_start_incomplete));
  CHECK(code::no_hello == int(ExitCode::no_hello));
  CHECK(code::wrong_protocol == int(ExitCode::wrong_protocol));
  CHECK(code::different_case == int(ExitCode::different_case));
  CHECK(code::missing_role == int(ExitCode::missing_role));
  CHECK(code::partner_silent == int(ExitCode::partner_silent));
  CHECK(code::message_out_of_order == int(ExitCode::message_out_of_order));
  CHECK(code::partner_failed == int(ExitCode::partner_failed));
}

// Truth: RFC 3720 B.4 (32 zeros, 32 ones) and the check value of the CRC catalogue ("123456789").
TEST_CASE("CRC-32C gives the published check values, by instruction and by table", "[link][unit]")
{
  const auto of = [](const std::string& text) { return std::as_bytes(std::span(text.data(), text.size())); };
  const std::string nine = "123456789";
  const std::string zeros(32, '\0');
  const std::string ones(32, '\xFF');
  for (auto crc : {wire::crc32c, wire::crc32c_by_table})
  {
    CHECK(crc(of(nine), 0) == 0xE3069283u);
    CHECK(crc(of(zeros), 0) == 0x8A9136AAu);
    CHECK(crc(of(ones), 0) == 0x62A8AB43u);
    CHECK(crc(of(nine).subspan(4), crc(of(nine).first(4), 0)) == 0xE3069283u); // in two pieces
  }
}

TEST_CASE("every message has the bytes of the independent packer", "[link][unit]")
{
  using enum MessageType;
  CHECK(hex(message_of(header(MessageType::setup), samples::setup())) == golden::setup);
  CHECK(hex(message_of(header(MessageType::mesh), samples::mesh())) == golden::mesh);
  CHECK(hex(message_of(header(MessageType::mesh), samples::thin_wall())) == golden::mesh_of_a_thin_wall);
  CHECK(hex(message_of(header(MessageType::mesh), samples::of_several_ranks())) ==
        golden::mesh_of_several_ranks);
  CHECK(hex(message_of(header(MessageType::surface), samples::mesh())) == golden::surface);
  CHECK(hex(message_of(header(MessageType::mesh_reply), samples::mesh_reply())) == golden::mesh_reply);
  CHECK(hex(message_of(header(ready), report())) == golden::ready);
  CHECK(hex(message_of(header(MessageType::window), samples::window())) == golden::window);
  CHECK(hex(message_of(header(MessageType::window), samples::window_on_trial())) == golden::window_on_trial);
  CHECK(hex(message_of(header(MessageType::window), samples::window_in_flight())) ==
        golden::window_in_flight);
  CHECK(hex(vector_message(free_velocity)) == golden::free_velocity);
  CHECK(hex(vector_message(link_force)) == golden::link_force);
  CHECK(hex(message_of(header(mesh_update), samples::mesh())) == golden::mesh_update);
  CHECK(hex(message_of(header(checkpoint), checkpoint_order())) == golden::checkpoint);
  CHECK(hex(message_of(header(MessageType::checkpoint_done), samples::checkpoint_done())) ==
        golden::checkpoint_done);
  CHECK(hex(reason_message(stop_request, "SIGTERM")) == golden::stop_request);
  CHECK(hex(reason_message(bye, "")) == golden::bye);
  CHECK(hex(empty_message(bye_ack)) == golden::bye_ack);
  CHECK(hex(message_of(header(fail), failed())) == golden::fail);
  CHECK(hex(empty_message(ping)) == golden::ping);
  CHECK(hex(message_of(header(MessageType::kinematics), samples::kinematics())) == golden::kinematics);
  CHECK(hex(message_of(header(activation_impulse), activation())) == golden::activation_impulse);
  CHECK(hex(message_of(header(MessageType::motion), samples::motion())) == golden::motion);
}

TEST_CASE("HELLO and ROSTER have the bytes of the independent packer", "[link][unit]")
{
  const Hello hello{.major = 1,
                    .minor = 0,
                    .dim = 2,
                    .capabilities = 6,
                    .case_hash = 0x1122334455667788u,
                    .world_rank = 3,
                    .pid = 4711,
                    .role = "solid",
                    .solver = "GetFEM 5.4.2",
                    .host = "node7",
                    .partners = {"coupler"}};
  const Bytes bytes = encode(hello);
  CHECK(bytes.size() == hello_size);
  CHECK(hex(bytes) == golden::hello);
  const Hello back = decode_hello(bytes);
  CHECK(encode(back) == bytes);
  CHECK(back.partners == hello.partners);

  const Roster roster{
      .major = 1,
      .text = "",
      .ranks = {{"coupler", "undine 0.1.0", "node1", 0}, {"solid", "GetFEM 5.4.2", "node7", 6}}};
  CHECK(hex(encode(roster)) == golden::roster);
  CHECK(encode(decode_roster(encode(roster))) == encode(roster));

  const Roster bad{.major = 1, .status = 35, .text = "no program with role 'solid'", .ranks = {}};
  CHECK(hex(encode(bad)) == golden::roster_with_error);
  CHECK(decode_roster(encode(bad)).text == bad.text);
}

TEST_CASE("what is written is what is read", "[link][unit]")
{
  const auto reader = [](const Bytes& bytes) { return wire::Reader(bytes, "the message"); };
  const std::vector<Bytes> sent = payloads();
  CHECK(payload_of(wire::read_setup(reader(sent[0]))) == sent[0]);
  CHECK(payload_of(wire::read_surface_mesh(reader(sent[1]))) == sent[1]);
  CHECK(payload_of(wire::read_mesh_reply(reader(sent[2]))) == sent[2]);
  CHECK(payload_of(wire::read_report(reader(sent[3]))) == sent[3]);
  CHECK(payload_of(wire::read_window(reader(sent[4]))) == sent[4]);
  CHECK(payload_of(wire::read_kinematics(reader(sent[5]), 2)) == sent[5]);
  CHECK(payload_of(wire::read_activation(reader(sent[6]), 2)) == sent[6]);
  CHECK(payload_of(wire::read_checkpoint_order(reader(sent[7]))) == sent[7]);
  CHECK(payload_of(wire::read_checkpoint_done(reader(sent[8]))) == sent[8]);
  CHECK(payload_of(wire::read_failed(reader(sent[9]))) == sent[9]);
  CHECK(wire::read_reason(reader(sent[10])) == "SIGTERM");
  CHECK(payload_of(wire::read_motion(reader(sent[11]), 2)) == sent[11]);
}

TEST_CASE("a window on trial or without exchange comes back as one", "[link][unit]")
{
  Window w = samples::window();
  for (int bits = 0; bits < 8; ++bits)
  {
    w.fine = bits & 1;
    w.trial = bits & 2;
    w.flight = bits & 4;
    const Bytes bytes = payload_of(w);
    const Window back = wire::read_window(wire::Reader(bytes, "the message"));
    CHECK(back.fine == w.fine);
    CHECK(back.trial == w.trial);
    CHECK(back.flight == w.flight);
  }
}

TEST_CASE("a header comes back as it was sealed", "[link][unit]")
{
  const Bytes bytes = message_of(header(MessageType::mesh), mesh());
  const wire::Header back = wire::open(bytes, "solid", nothing_special);
  CHECK(back.type == MessageType::mesh);
  CHECK(back.sequence == 5);
  CHECK(back.window == 41);
  CHECK(back.t == 0.25);
  CHECK(back.dt == 0.125);
  CHECK(back.payload_bytes == bytes.size() - wire::header_size);
}

TEST_CASE("a message with any one bit flipped is rejected", "[link][unit]")
{
  const Bytes good = message_of(header(MessageType::mesh), mesh());
  for (std::size_t i = 0; i < good.size(); ++i)
    for (unsigned bit = 0; bit < 8; ++bit)
    {
      Bytes bad = good;
      bad[i] ^= std::byte(1u << bit);
      const ProtocolError error = error_of([&] { wire::open(bad, "solid", nothing_special); });
      REQUIRE(error.code() == 37);
      REQUIRE(mentions(error, {"'solid' sent", "expected WINDOW"}));
    }
}

TEST_CASE("a message cut at any length, or with bytes behind its end, is rejected", "[link][unit]")
{
  const Bytes good = message_of(header(MessageType::mesh), mesh());
  for (std::size_t size = 0; size < good.size(); ++size)
  {
    const ProtocolError error =
        error_of([&] { wire::open(std::span(good).first(size), "solid", nothing_special); });
    REQUIRE(error.code() == 37);
    REQUIRE(mentions(error, {"'solid' sent", "expected WINDOW"}));
  }
  Bytes longer = good;
  longer.push_back(std::byte{0});
  const ProtocolError error = error_of([&] { wire::open(longer, "solid", nothing_special); });
  CHECK(error.code() == 37);
  CHECK(mentions(error, {"MESH #5 with 284 payload bytes", "announces 283", "expected WINDOW"}));
}

TEST_CASE("a payload cut at any length, or too long, is rejected", "[link][unit]")
{
  const auto all = readers();
  const auto sent = payloads();
  for (std::size_t i = 0; i < all.size(); ++i)
  {
    INFO(all[i].first);
    CHECK_NOTHROW(all[i].second(sent[i]));
    for (std::size_t size = 0; size < sent[i].size(); ++size)
    {
      const ProtocolError error = error_of([&] { all[i].second(std::span(sent[i]).first(size)); });
      REQUIRE(error.code() == 37);
      REQUIRE(mentions(error, {"the message", "too short", "expected"}));
    }
    Bytes longer = sent[i];
    longer.push_back(std::byte{0});
    const ProtocolError error = error_of([&] { all[i].second(longer); });
    CHECK(error.code() == 37);
    CHECK(mentions(error, {"the message", "too long: 1 bytes", "expected 0"}));
  }
}

// 2^61 doubles would be 2^64 bytes: the product must not wrap, and nothing of the kind may be allocated.
TEST_CASE("an announced size beyond the bytes that came is rejected before anything is allocated",
          "[link][unit]")
{
  const std::uint64_t count = GENERATE(std::uint64_t(1) << 61, ~std::uint64_t(0), std::uint64_t(1) << 40);
  Bytes lie;
  wire::Writer out(lie);
  out.u64(count);
  out.f64(1.0);
  const ProtocolError error = error_of([&] { wire::read_kinematics(wire::Reader(lie, "KINEMATICS #3"), 2); });
  CHECK(error.code() == 37);
  CHECK(mentions(error,
                 {"KINEMATICS #3", "v announces", std::to_string(count).c_str(), "expected at most the 1"}));
}

TEST_CASE("random bytes with a good checksum never get past the readers unnoticed", "[link][unit]")
{
  // Random damage of good payloads: either the content is still a possible one, or ProtocolError(37).
  // Anything else (a crash, another exception, a huge allocation) ends the test.
  std::mt19937 random(12345);
  const auto all = readers();
  const auto sent = payloads();
  int rejected = 0;
  for (int trial = 0; trial < 20000; ++trial)
  {
    const std::size_t i = std::size_t(trial) % all.size();
    Bytes bad = sent[i];
    const auto hits = 1 + random() % 4;
    for (unsigned hit = 0; hit < hits; ++hit)
      bad[random() % bad.size()] = std::byte(random() & 255u);
    const ProtocolError error = error_of([&] { all[i].second(bad); });
    REQUIRE((error.code() == 37 || error.code() == 0));
    rejected += error.code() == 37 ? 1 : 0;
  }
  CHECK(rejected > 1000);
}

TEST_CASE("numbers that are not finite are rejected wherever they stand", "[link][unit]")
{
  const double bad = GENERATE(std::nan(""), std::numeric_limits<double>::infinity(),
                              -std::numeric_limits<double>::infinity());
  const auto rejected = [](const Bytes& payload, auto read, std::initializer_list<const char*> words)
  {
    const ProtocolError error = error_of([&] { read(wire::Reader(payload, "the message")); });
    CHECK(error.code() == 37);
    CHECK(mentions(error, words));
    CHECK(mentions(error, {"expected a finite number"}));
  };
  SurfaceMesh m = mesh();
  m.x[3] = bad;
  rejected(payload_of(m), wire::read_surface_mesh, {"x[3]"});
  m = mesh();
  m.inverse_mass[7] = bad;
  rejected(payload_of(m), wire::read_surface_mesh, {"inverse_mass[7]"});
  Report r = report();
  r.stable_dt = bad;
  rejected(payload_of(r), wire::read_report, {"stable_dt"});
  Window w = window();
  w.t_end = bad;
  rejected(payload_of(w), wire::read_window, {"t_end"});
  Kinematics k = kinematics();
  k.a_free[1] = bad;
  rejected(payload_of(k), [](wire::Reader in) { return wire::read_kinematics(std::move(in), 2); },
           {"a_free[1]"});
  Activation a = activation();
  a.impulse[0] = bad;
  rejected(payload_of(a), [](wire::Reader in) { return wire::read_activation(std::move(in), 2); },
           {"impulse[0]"});

  std::vector<double> values(1001, 1e308);
  CHECK(wire::first_not_finite(values) == values.size());
  values[1000] = bad;
  CHECK(wire::first_not_finite(values) == 1000);
  values[17] = bad;
  CHECK(wire::first_not_finite(values) == 17);
}

TEST_CASE("a surface that contradicts itself is rejected with what came and what was expected",
          "[link][unit]")
{
  const auto rejected = [](auto change, std::initializer_list<const char*> words)
  {
    SurfaceMesh m = mesh();
    change(m);
    const ProtocolError error =
        error_of([&] { wire::read_surface_mesh(wire::Reader(payload_of(m), "MESH #2 from 'solid'")); });
    CHECK(error.code() == 37);
    CHECK(mentions(error, words));
  };
  rejected([](SurfaceMesh& m) { m.dim = 4; }, {"dim is 4", "expected 2 or 3"});
  rejected([](SurfaceMesh& m) { m.x.pop_back(); }, {"size of x is 5", "expected 6"});
  rejected([](SurfaceMesh& m) { m.inverse_mass.resize(6); }, {"size of inverse_mass is 6", "expected 12"});
  rejected([](SurfaceMesh& m) { m.face_nodes[2] = 3; }, {"face_nodes[2] is 3", "0..2"});
  rejected([](SurfaceMesh& m) { m.face_nodes[2] = -1; }, {"face_nodes[2] is -1", "0..2"});
  rejected([](SurfaceMesh& m) { m.face_interface[1] = 2; }, {"face_interface[1] is 2", "2 interfaces"});
  rejected([](SurfaceMesh& m) { m.face_offset[1] = 1; }, {"face_offset[1] is 1", "0 + 2"});
  rejected([](SurfaceMesh& m) { m.face_offset[2] = 5; }, {"size of face_nodes is 4", "expected 5"});
  rejected([](SurfaceMesh& m) { m.node_id[2] = 11; }, {"11 twice", "each node once"});
  rejected(
      [](SurfaceMesh& m) {
        m.coupled_nodes = {0, 0};
      },
      {"size of coupled_inverse_mass is 0", "expected 4"});
  rejected(
      [](SurfaceMesh& m)
      {
        m.coupled_nodes = {1, 1};
        m.coupled_inverse_mass.resize(4);
      },
      {"coupled_nodes[1] is 1", "two different ones"});
  rejected(
      [](SurfaceMesh& m)
      {
        m.coupled_nodes = {1, 3};
        m.coupled_inverse_mass.resize(4);
      },
      {"coupled_nodes[1] is 3", "0..2"});
}

TEST_CASE("pairs of nodes that move each other arrive as they were sent", "[link][unit]")
{
  SurfaceMesh m = mesh();
  m.coupled_nodes = {0, 2};
  m.coupled_inverse_mass = {1.0, 0.25, -0.5, 2.0};
  const SurfaceMesh back = wire::read_surface_mesh(wire::Reader(payload_of(m), "the message"));
  CHECK(back.coupled_nodes == m.coupled_nodes);
  CHECK(back.coupled_inverse_mass == m.coupled_inverse_mass);
  CHECK(back.face_nodes == m.face_nodes);
}

TEST_CASE("orders that cannot be carried out are rejected", "[link][unit]")
{
  Window w = window();
  w.steps = 0;
  CHECK(mentions(error_of([&] { wire::read_window(wire::Reader(payload_of(w), "WINDOW #9")); }),
                 {"WINDOW #9", "steps is 0", "at least 1"}));
  w = window();
  w.t_end = w.t_begin;
  CHECK(mentions(error_of([&] { wire::read_window(wire::Reader(payload_of(w), "WINDOW #9")); }),
                 {"t_end is 0.25", "later than t_begin = 0.25"}));
  Report r = report();
  r.stable_dt = 0.0;
  CHECK(mentions(error_of([&] { wire::read_report(wire::Reader(payload_of(r), "READY #4")); }),
                 {"stable_dt is 0", "positive"}));
}

TEST_CASE("the text of a failure is cut at a kilobyte, not inside a character", "[link][unit]")
{
  std::string text(wire::longest_failure_text - 1, 'a');
  text += "λ and more"; // two bytes, of which only the first would fit
  const wire::Failed back =
      wire::read_failed(wire::Reader(payload_of(wire::Failed{.code = 10, .text = text}), "FAIL #7"));
  CHECK(back.text == std::string(wire::longest_failure_text - 1, 'a'));
}
