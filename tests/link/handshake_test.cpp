// The judgement over the HELLOs of a world, and the reading of greetings that are none.
#include "common/coupling/handshake.hpp"

#include "tests/link/samples.hpp"

#include <catch2/catch.hpp>

#include <optional>

using namespace samples;

namespace
{

using World = std::vector<std::optional<Hello>>;

Hello hello(const char* role, int rank, std::vector<std::string> partners)
{
  return {.major = 1,
          .dim = 2,
          .case_hash = 7,
          .world_rank = rank,
          .role = role,
          .solver = std::string(role) + " 1.0",
          .host = "node" + std::to_string(rank),
          .partners = std::move(partners)};
}

World good_world()
{
  return {hello("coupler", 0, {"fluid", "solid"}), hello("fluid", 1, {"coupler"}),
          hello("fluid", 2, {"coupler"}), hello("solid", 3, {"coupler"})};
}

ProtocolError as_error(const Verdict& verdict) { return ProtocolError(verdict.code, verdict.text); }

} // namespace

TEST_CASE("a complete world passes", "[link][unit]")
{
  const World world = good_world();
  CHECK(judge_pairs(world).code == 0);
  CHECK(judge_silence(world, 5.0).code == 0);
  CHECK(judge_roles(world).code == 0);
}

TEST_CASE("a program that runs alone passes on any number of ranks", "[link][unit]")
{
  const World world{hello("fluid", 0, {}), hello("fluid", 1, {})};
  CHECK(judge_pairs(world).code == 0);
  CHECK(judge_roles(world).code == 0);
}

TEST_CASE("silent ranks are named", "[link][unit]")
{
  World world = good_world();
  world[1].reset();
  world[3].reset();
  const Verdict verdict = judge_silence(world, 5.0);
  CHECK(verdict.code == 32);
  CHECK(mentions(as_error(verdict), {"no hello from world rank(s) 1, 3 within 5 s"}));
}

TEST_CASE("another major version is refused with both versions, role, rank and host", "[link][unit]")
{
  World world = good_world();
  world[3]->major = 2;
  world[1].reset(); // at once, although somebody has not spoken yet
  const Verdict verdict = judge_pairs(world);
  CHECK(verdict.code == 33);
  CHECK(mentions(as_error(verdict), {"'solid' (solid 1.0, rank 3 on node3) speaks protocol 2.0",
                                     "'coupler' (coupler 1.0, rank 0 on node0) speaks 1.0"}));
}

TEST_CASE("another minor version is accepted", "[link][unit]")
{
  World world = good_world();
  world[3]->minor = 4;
  CHECK(judge_pairs(world).code == 0);
}

TEST_CASE("another byte order is refused", "[link][unit]")
{
  World world = good_world();
  world[2]->endian = 0x04030201u;
  CHECK(judge_pairs(world).code == 33);
  CHECK(mentions(as_error(judge_pairs(world)), {"rank 2 on node2", "byte order"}));
}

TEST_CASE("programs that read different cases are refused, one that read none is not", "[link][unit]")
{
  World world = good_world();
  world[3]->case_hash = 8;
  CHECK(judge_pairs(world).code == 34);
  CHECK(mentions(as_error(judge_pairs(world)), {"'solid' (solid 1.0, rank 3 on node3)", "'coupler'",
                                                "0000000000000008", "0000000000000007"}));
  world[3]->case_hash = 0;
  CHECK(judge_pairs(world).code == 0);
  world[0]->case_hash = 0; // also when the coupler is the one that read nothing
  world[2]->case_hash = 9;
  CHECK(judge_pairs(world).code == 34);
}

TEST_CASE("a missing role is named, with what was found", "[link][unit]")
{
  World world = good_world();
  world.pop_back();
  const Verdict verdict = judge_roles(world);
  CHECK(verdict.code == 35);
  CHECK(mentions(as_error(verdict), {"no program with role 'solid' (found: coupler x1, fluid x2)"}));
}

TEST_CASE("a solver of a coupled case that is started alone says how to start it", "[link][unit]")
{
  const World world{hello("solid", 0, {"coupler"})};
  const Verdict verdict = judge_roles(world);
  CHECK(verdict.code == 35);
  CHECK(mentions(as_error(verdict),
                 {"no program with role 'coupler' (found: solid x1)", "started alone", "--mpi=pmix"}));
}

TEST_CASE("a doubled role is refused", "[link][unit]")
{
  World world = good_world();
  world.push_back(hello("coupler", 4, {"fluid", "solid"})); // its second rank
  CHECK(judge_roles(world).code == 0);
  world.back()->solver = "another coupler";
  CHECK(judge_roles(world).code == 35);
  CHECK(mentions(as_error(judge_roles(world)), {"role 'coupler' is doubled", "another coupler, rank 4"}));

  world = good_world();
  world.push_back(hello("solid", 4, {"coupler"}));
  world.back()->solver = "GetFEM 5.4.2";
  CHECK(judge_roles(world).code == 35);
  CHECK(
      mentions(as_error(judge_roles(world)), {"role 'solid' is doubled", "rank 3", "GetFEM 5.4.2, rank 4"}));
}

TEST_CASE("a program that the coupler does not couple is refused", "[link][unit]")
{
  World world = good_world();
  world.push_back(hello("spectator", 4, {}));
  CHECK(judge_roles(world).code == 35);
  CHECK(mentions(as_error(judge_roles(world)), {"'spectator'", "fluid, solid"}));
}

TEST_CASE("a greeting that is no HELLO or ROSTER is refused", "[link][unit]")
{
  CHECK(error_of([] { decode_hello(Bytes(511)); }).code() == 33);
  CHECK(error_of([] { decode_hello(Bytes(512)); }).code() == 33);
  CHECK(error_of([] { decode_roster(Bytes(7)); }).code() == 33);
  CHECK(error_of([] { decode_roster(Bytes(100)); }).code() == 33);
  const Bytes roster = encode(Roster{.major = 1, .text = "", .ranks = {{"coupler", "a", "b"}}});
  for (std::size_t size = 8; size < roster.size(); ++size)
    REQUIRE(error_of([&] { decode_roster(std::span(roster).first(size)); }).code() == 37);
}

TEST_CASE("names too long for a HELLO are cut, roles are refused", "[link][unit]")
{
  Hello h = hello("solid", 0, {});
  h.solver = std::string(200, 's');
  CHECK(decode_hello(encode(h)).solver == std::string(95, 's'));
  h.role = std::string(32, 'r');
  CHECK(error_of([&] { encode(h); }).code() == 1);
}
