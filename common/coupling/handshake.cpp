// HELLO and ROSTER as bytes, and the judgement over all HELLOs.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/handshake.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/text.hpp"
#include "common/coupling/wire.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <map>

namespace undine::link
{
namespace
{

constexpr std::array<unsigned char, 8> hello_magic{0x89, 'F', 'S', 'I', '\r', '\n', 0x1A, '\n'};
constexpr std::array<unsigned char, 8> roster_magic{0x89, 'F', 'S', 'R', '\r', '\n', 0x1A, '\n'};
constexpr std::size_t role_size = 32;
constexpr std::size_t solver_size = 96;
constexpr std::size_t host_size = 64;
constexpr std::size_t partners_size = 128;

/// Zero-padded text; at least one zero ends it.
void fixed_text(wire::Writer& out, const std::string& text, std::size_t size)
{
  const std::size_t n = std::min(text.size(), size - 1);
  out.bytes(text.data(), n);
  out.zeros(size - n);
}

std::string fixed_text(wire::Reader& in, const char* field, std::size_t size)
{
  std::string text(size, '\0');
  in.bytes(field, text.data(), size);
  return text.substr(0, text.find('\0'));
}

std::string joined(const std::vector<std::string>& names, const char* between)
{
  std::string text;
  for (const std::string& name : names)
    text += (text.empty() ? "" : between) + name;
  return text;
}

std::vector<std::string> split(const std::string& text)
{
  std::vector<std::string> names;
  for (std::size_t begin = 0; begin < text.size();)
  {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    names.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return names;
}

std::string version(const Hello& h) { return std::to_string(h.major) + "." + std::to_string(h.minor); }

/// 'solid' (GetFEM 5.4.2, rank 2 on node7)
std::string who(const Hello& h)
{
  return "'" + h.role + "' (" + h.solver + ", rank " + std::to_string(h.world_rank) + " on " + h.host + ")";
}

std::string hash_text(std::uint64_t hash)
{
  char text[32];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

/// The program that the others are compared with: the coupler if it has spoken, else the first that has.
const Hello* reference(std::span<const std::optional<Hello>> hellos)
{
  const Hello* first = nullptr;
  for (const auto& hello : hellos)
    if (hello)
    {
      if (hello->role == "coupler")
        return &*hello;
      if (first == nullptr)
        first = &*hello;
    }
  return first;
}

/// "coupler x1, fluid x2" in order of appearance.
std::string found(std::span<const std::optional<Hello>> hellos)
{
  std::vector<std::pair<std::string, int>> counts;
  for (const auto& hello : hellos)
  {
    const auto known =
        std::find_if(counts.begin(), counts.end(), [&](const auto& c) { return c.first == hello->role; });
    if (known != counts.end())
      ++known->second;
    else
      counts.emplace_back(hello->role, 1);
  }
  std::string text;
  for (const auto& [role, n] : counts)
    text += (text.empty() ? "" : ", ") + role + " x" + std::to_string(n);
  return text;
}

Verdict judge_versions(const Hello& reference, const Hello& other)
{
  if (other.endian != reference.endian)
    return {code::wrong_protocol, who(other) + " has another byte order than " + who(reference) +
                                      "\n       all programs of a run need machines of the same byte order."};
  if (other.major != reference.major)
  {
    const bool older = other.major < reference.major;
    return {code::wrong_protocol, who(other) + " speaks protocol " + version(other) + ", " + who(reference) +
                                      " speaks " + version(reference) + "\n       rebuild '" +
                                      (older ? other.role : reference.role) + "' against protocol " +
                                      std::to_string(std::max(other.major, reference.major)) +
                                      ".x, or use an older '" + (older ? reference.role : other.role) + "'."};
  }
  return {};
}

Verdict judge_case(const Hello& a, const Hello& b)
{
  if (a.case_hash != b.case_hash)
    return {code::different_case,
            who(b) + " read another case than " + who(a) + ": content hashes " + hash_text(b.case_hash) +
                " and " + hash_text(a.case_hash) +
                "\n       give the same case file and the same --set options to all programs."};
  if (a.dim != 0 && b.dim != 0 && a.dim != b.dim)
    return {code::different_case, who(b) + " computes in " + std::to_string(b.dim) + " dimensions, " +
                                      who(a) + " in " + std::to_string(a.dim)};
  return {};
}

} // namespace

std::vector<std::byte> encode(const Hello& h)
{
  const std::string partners = joined(h.partners, ",");
  if (h.role.empty() || h.role.size() >= role_size || h.role.find(',') != std::string::npos)
    throw ProtocolError(code::internal_error,
                        "role '" + h.role + "': expected 1 to 31 bytes without a comma");
  if (partners.size() >= partners_size)
    throw ProtocolError(code::internal_error, "partners '" + partners + "': expected less than 128 bytes");

  std::vector<std::byte> bytes;
  wire::Writer out(bytes);
  out.bytes(hello_magic.data(), hello_magic.size());
  out.u16(h.major);
  out.u16(h.minor);
  out.u32(h.endian);
  out.u8(sizeof(int));
  out.u8(sizeof(long));
  out.u8(static_cast<std::uint8_t>(h.dim));
  out.u64(h.capabilities);
  out.u64(h.case_hash);
  out.i32(h.world_rank);
  out.i32(h.pid);
  fixed_text(out, h.role, role_size);
  fixed_text(out, h.solver, solver_size);
  fixed_text(out, h.host, host_size);
  fixed_text(out, partners, partners_size);
  out.zeros(hello_size - bytes.size());
  return bytes;
}

Hello decode_hello(std::span<const std::byte> bytes)
{
  if (bytes.size() != hello_size || std::memcmp(bytes.data(), hello_magic.data(), hello_magic.size()) != 0)
    throw ProtocolError(code::wrong_protocol, "a message of " + std::to_string(bytes.size()) +
                                                  " bytes came where a HELLO of 512 bytes was expected");
  wire::Reader in(bytes.subspan(hello_magic.size()), "HELLO");
  Hello h;
  h.major = in.u16("major");
  h.minor = in.u16("minor");
  h.endian = in.u32("endian");
  in.u8("sizeof_int");
  in.u8("sizeof_long");
  h.dim = in.u8("dim");
  h.capabilities = in.u64("capabilities");
  h.case_hash = in.u64("case_hash");
  h.world_rank = in.i32("world_rank");
  h.pid = in.i32("pid");
  h.role = fixed_text(in, "role", role_size);
  h.solver = fixed_text(in, "solver", solver_size);
  h.host = fixed_text(in, "host", host_size);
  h.partners = split(fixed_text(in, "partners", partners_size));
  return h;
}

std::vector<std::byte> encode(const Roster& roster)
{
  std::vector<std::byte> bytes;
  wire::Writer out(bytes);
  out.bytes(roster_magic.data(), roster_magic.size());
  out.u16(roster.major);
  out.u16(roster.minor);
  out.i32(roster.status);
  out.string(roster.text);
  if (roster.status != 0)
    return bytes;
  out.u64(roster.ranks.size());
  for (const RosterEntry& rank : roster.ranks)
  {
    out.string(rank.role);
    out.string(rank.solver);
    out.string(rank.host);
    out.u64(rank.capabilities);
  }
  return bytes;
}

Roster decode_roster(std::span<const std::byte> bytes)
{
  if (bytes.size() < roster_magic.size() ||
      std::memcmp(bytes.data(), roster_magic.data(), roster_magic.size()) != 0)
    throw ProtocolError(code::wrong_protocol, "world rank 0 answered the HELLO with " +
                                                  std::to_string(bytes.size()) + " bytes that are no ROSTER");
  wire::Reader in(bytes.subspan(roster_magic.size()), "ROSTER");
  Roster roster;
  roster.major = in.u16("major");
  roster.minor = in.u16("minor");
  roster.status = in.i32("status");
  roster.text = in.string("text");
  if (roster.status != 0)
    return roster;
  const std::uint64_t n = in.u64("number of ranks");
  if (n > in.left() / (3 * sizeof(std::uint32_t)))
    in.reject("number of ranks", std::to_string(n), "not more than the bytes left can hold");
  roster.ranks.resize(n);
  for (RosterEntry& rank : roster.ranks)
  {
    rank.role = in.string("role");
    rank.solver = in.string("solver");
    rank.host = in.string("host");
    rank.capabilities = in.u64("capabilities");
  }
  in.end();
  return roster;
}

Verdict judge_pairs(std::span<const std::optional<Hello>> hellos)
{
  const Hello* first = reference(hellos);
  if (first == nullptr)
    return {};
  for (const auto& hello : hellos)
    if (hello)
      if (Verdict verdict = judge_versions(*first, *hello); verdict.code != 0)
        return verdict;

  const Hello* reader = first->case_hash != 0 ? first : nullptr; // a program that has read the case
  for (const auto& hello : hellos)
    if (hello && hello->case_hash != 0)
    {
      if (reader == nullptr)
        reader = &*hello;
      if (Verdict verdict = judge_case(*reader, *hello); verdict.code != 0)
        return verdict;
    }
  return {};
}

Verdict judge_silence(std::span<const std::optional<Hello>> hellos, double seconds)
{
  std::string ranks;
  for (std::size_t rank = 0; rank < hellos.size(); ++rank)
    if (!hellos[rank])
      ranks += (ranks.empty() ? "" : ", ") + std::to_string(rank);
  if (ranks.empty())
    return {};
  return {code::no_hello,
          "no hello from world rank(s) " + ranks + " within " + number_text(seconds) +
              " s\n       that program does not speak the Undine protocol, or hangs while it starts; ranks "
              "count the programs of the mpirun line from 0."};
}

Verdict judge_roles(std::span<const std::optional<Hello>> hellos)
{
  const auto count = [&](const std::string& role)
  { return std::count_if(hellos.begin(), hellos.end(), [&](const auto& h) { return h->role == role; }); };

  std::map<std::string, const Hello*> first;
  for (const auto& hello : hellos)
  {
    const auto [known, is_new] = first.try_emplace(hello->role, &*hello);
    if (!is_new && known->second->solver != hello->solver)
      return {code::missing_role,
              "role '" + hello->role + "' is doubled: " + who(*known->second) + " and " + who(*hello)};
  }

  for (const auto& hello : hellos)
    for (const std::string& partner : hello->partners)
      if (count(partner) == 0)
      {
        std::string text = "no program with role '" + partner + "' (found: " + found(hellos) + "), but '" +
                           hello->role + "' needs it\n       ";
        text += hellos.size() == 1 ? "this program was started alone: use scripts/run, one mpirun line for "
                                     "all programs, or srun --mpi=pmix."
                                   : "add it to the mpirun line.";
        return {code::missing_role, text};
      }

  if (count("coupler") > 0)
  {
    const auto& coupler =
        *std::find_if(hellos.begin(), hellos.end(), [](const auto& h) { return h->role == "coupler"; });
    for (const auto& hello : hellos)
      if (hello->role != "coupler" && std::find(coupler->partners.begin(), coupler->partners.end(),
                                                hello->role) == coupler->partners.end())
        return {code::missing_role, who(*hello) +
                                        " has a role that the coupler does not couple (it couples: " +
                                        joined(coupler->partners, ", ") + ")"};
  }
  return {};
}

} // namespace undine::link
