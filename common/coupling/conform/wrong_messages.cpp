// What is done to a message so that it is wrong.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conform/wrong_messages.hpp"

#include <cstdint>
#include <cstring>
#include <limits>

namespace undine::link::conform
{
namespace
{

/// Writes the checksum anew: what is wrong is something else.
void reseal(std::vector<std::byte>& message)
{
  const std::uint64_t size = message.size() - wire::header_size;
  std::memcpy(message.data() + 40, &size, sizeof size);
  const std::uint32_t zero = 0;
  std::memcpy(message.data() + 48, &zero, sizeof zero);
  const std::uint32_t crc = wire::crc32c(message);
  std::memcpy(message.data() + 48, &crc, sizeof crc);
}

} // namespace

const std::vector<std::pair<Script, Wrong>>& wrong_messages()
{
  using Bytes = std::vector<std::byte>;
  static const std::vector<std::pair<Script, Wrong>> list{
      {{"wrong checksum", "one bit of a LINK_FORCE is flipped", 37, "3.3"},
       {MessageType::link_force, 2, [](Bytes& m) { m.back() ^= std::byte{1}; }}},
      {{"wrong magic", "a message of somebody else", 37, "3.3"},
       {MessageType::window, 2, [](Bytes& m) { m[0] ^= std::byte{0x20}; }}},
      {{"truncated message", "a LINK_FORCE ends early", 37, "3.3"},
       {MessageType::link_force, 2, [](Bytes& m) { m.resize(m.size() - 8); }}},
      {{"short header", "ten bytes instead of a message", 37, "3.3"},
       {MessageType::window, 2, [](Bytes& m) { m.resize(10); }}},
      {{"wrong size", "a LINK_FORCE for one node less, well formed", 37, "3.3"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          m.resize(m.size() - 8);
          reseal(m);
        }}},
      {{"oversized count", "an ACTIVATION_IMPULSE that promises 2^60 numbers", 37, "3.3"},
       {MessageType::activation_impulse, 1,
        [](Bytes& m)
        {
          const std::uint64_t count = 1ull << 60;
          std::memcpy(m.data() + wire::header_size, &count, sizeof count);
          reseal(m);
        }}},
      {{"NaN", "a LINK_FORCE with a number that is none", 37, "3.3"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const double nan = std::numeric_limits<double>::quiet_NaN();
          std::memcpy(m.data() + m.size() - 8, &nan, sizeof nan);
          reseal(m);
        }}},
      {{"lost message", "a sequence number is left out", 37, "3.3"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          std::uint64_t sequence = 0;
          std::memcpy(&sequence, m.data() + 8, sizeof sequence);
          ++sequence;
          std::memcpy(m.data() + 8, &sequence, sizeof sequence);
          reseal(m);
        }}},
      {{"out of order", "MESH_REPLY where LINK_FORCE is expected", 37, "4.1"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const auto type = static_cast<std::uint16_t>(MessageType::mesh_reply);
          std::memcpy(m.data() + 4, &type, sizeof type);
          reseal(m);
        }}},
      {{"unknown type", "a message of type 999", 37, "4.1"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const std::uint16_t type = 999;
          std::memcpy(m.data() + 4, &type, sizeof type);
          reseal(m);
        }}},
      {{"wrong window", "a LINK_FORCE of another window", 37, "4.1"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const std::int64_t window = 4711;
          std::memcpy(m.data() + 16, &window, sizeof window);
          reseal(m);
        }}},
  };
  return list;
}

} // namespace undine::link::conform
