// The bytes of the protocol: writers, readers, CRC, headers. Payloads: payloads.cpp.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/wire.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/text.hpp"

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
    throw ProtocolError(code::message_out_of_order, what_ + " is too short: " + std::to_string(rest_.size()) +
                                                        " bytes are left for " + field + ", expected " +
                                                        std::to_string(size));
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
    throw ProtocolError(code::message_out_of_order,
                        what_ + " is too short: " + field + " announces " + std::to_string(n) +
                            " items, expected at most the " + std::to_string(rest_.size() / item_size) +
                            " that the " + std::to_string(rest_.size()) + " bytes left can hold");
  return static_cast<std::size_t>(n);
}

std::string Reader::string(const char* field)
{
  const std::uint32_t n = u32(field);
  if (n > rest_.size())
    throw ProtocolError(code::message_out_of_order, what_ + " is too short: " + field + " announces " +
                                                        std::to_string(n) + " bytes, expected at most the " +
                                                        std::to_string(rest_.size()) + " that are left");
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
    throw ProtocolError(code::message_out_of_order, what_ + " is too long: " + std::to_string(rest_.size()) +
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
    reject("a message of " + std::to_string(message.size()) + " bytes, which is less than the header's 64");

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
    reject(name() + " with " + std::to_string(message.size() - header_size) +
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

} // namespace undine::link::wire
