// HELLO and ROSTER, the messages before there are channels, and the judgement over all HELLOs.
// SPDX-License-Identifier: BSD-3-Clause
//
// HELLO is 512 bytes, little-endian, packed, and its layout never changes, so that any version can read any
// other's:
//     0  u8[8] magic     89 'F' 'S' 'I' 0D 0A 1A 0A
//     8  u16 major, u16 minor
//    12  u32 endian      0x01020304 in the sender's own byte order
//    16  u8 sizeof_int, u8 sizeof_long, u8 dim
//    19  u64 capabilities
//    27  u64 case_hash   0: did not read the case
//    35  i32 world_rank, i32 pid
//    43  char role[32], char solver[96], char host[64]     zero-padded UTF-8
//   235  char partners[128]   roles that must be present, separated by commas
//   363  zero
// ROSTER starts with the same kind of fixed part, so that the verdict can be read by any version:
//     0  u8[8] magic     89 'F' 'S' 'R' 0D 0A 1A 0A
//     8  u16 major, u16 minor
//    12  i32 status      0 or an exit code
//    16  u32 length, text of the error
// and goes on, only after status 0, with u64 n and for each world rank: string role, string solver, string
// host, u64 capabilities.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace undine::link
{

inline constexpr std::size_t hello_size = 512;

/// Bits of Hello::capabilities: what a participant can do.
namespace capability
{
inline constexpr std::uint64_t force_in =
    1u << 0; ///< level A: takes nodal forces, returns positions and velocities
inline constexpr std::uint64_t link = 1u << 1;    ///< level B: returns free velocities, takes link forces
inline constexpr std::uint64_t contact = 1u << 2; ///< level B with the exchange in the middle of the step
inline constexpr std::uint64_t rewind = 1u << 3;  ///< level B: runs a window on trial (Window::trial)
inline constexpr std::uint64_t flight = 1u << 4;  ///< contact: runs steps without exchange (Window::flight)
/// A participant: MESH may give rows to several of its ranks. A coupler: it exchanges them with these ranks.
inline constexpr std::uint64_t distributed = 1u << 5;
} // namespace capability

struct Hello
{
  std::uint16_t major = 0;
  std::uint16_t minor = 0;
  std::uint32_t endian = 0x01020304u;
  int dim = 0;
  std::uint64_t capabilities = 0;
  std::uint64_t case_hash = 0;
  std::int32_t world_rank = 0;
  std::int32_t pid = 0;
  std::string role;
  std::string solver;
  std::string host;
  std::vector<std::string> partners;
};

struct RosterEntry
{
  std::string role;
  std::string solver;
  std::string host;
  std::uint64_t capabilities = 0;
};

struct Roster
{
  std::uint16_t major = 0;
  std::uint16_t minor = 0;
  int status = 0;
  std::string text;
  std::vector<RosterEntry> ranks; ///< by world rank; empty if status is not 0
};

/// Names that do not fit are cut; @throws ProtocolError(1) if role or partners do not fit.
std::vector<std::byte> encode(const Hello&);
/// @throws ProtocolError(33) if this is not a HELLO
Hello decode_hello(std::span<const std::byte>);
std::vector<std::byte> encode(const Roster&);
/// @throws ProtocolError(33) if this is not a ROSTER, 37 if it is damaged
Roster decode_roster(std::span<const std::byte>);

struct Verdict
{
  int code = 0; ///< 0: all is well
  std::string text;
};

/// What can be judged as soon as two ranks have spoken: versions, byte order, cases. `hellos[r]` is empty
/// while rank r is silent.
Verdict judge_pairs(std::span<const std::optional<Hello>> hellos);
/// Silent ranks, after the deadline of `seconds`.
Verdict judge_silence(std::span<const std::optional<Hello>> hellos, double seconds);
/// Roles of a complete world.
Verdict judge_roles(std::span<const std::optional<Hello>> hellos);

} // namespace undine::link
