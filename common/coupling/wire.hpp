// The bytes of the protocol: a 64-byte header and one payload per message type.
// SPDX-License-Identifier: BSD-3-Clause
//
// Little-endian, packed, no padding inside payloads. string = u32 length + bytes; list = u64 count + items.
//
// Header, byte offsets:
//    0  u32 magic          "UND1"
//    4  u16 type           MessageType
//    6  u16 flags          0 in protocol 1.0
//    8  u64 sequence       1, 2, 3, ... per direction
//   16  i64 window         index of the window in progress, -1 before the first
//   24  f64 t              time the content belongs to [s]
//   32  f64 dt             step of the receiver or sender in this window [s]
//   40  u64 payload_bytes
//   48  u32 crc32c         of header (with this field zero) and payload
//   52  12 bytes           zero; for later minor versions
#pragma once

#include "common/coupling/channel.hpp"
#include "common/coupling/messages.hpp"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace undine::link::wire
{

// The hot messages copy arrays of double as they lie in memory.
static_assert(std::endian::native == std::endian::little, "the wire format is little-endian");
static_assert(sizeof(double) == 8);

inline constexpr std::size_t header_size = 64;
inline constexpr std::uint32_t magic = 0x31444E55; ///< "UND1" in memory

/// What precedes every payload. `payload_bytes` and `crc` are filled in by seal().
struct Header
{
  MessageType type = MessageType::ping;
  std::uint16_t flags = 0;
  std::uint64_t sequence = 0;
  std::int64_t window = -1;
  double t = 0.0;
  double dt = 0.0;
  std::uint64_t payload_bytes = 0;
  std::uint32_t crc = 0;
};

/// CRC-32C (Castagnoli polynomial, reflected 0x82F63B78; RFC 3720). `crc` continues an earlier call.
std::uint32_t crc32c(std::span<const std::byte> bytes, std::uint32_t crc = 0);

/// The same by table, for processors without the instruction; the tests compare both.
std::uint32_t crc32c_by_table(std::span<const std::byte> bytes, std::uint32_t crc = 0);

/// Appends values to a buffer whose capacity is kept from message to message.
class Writer
{
public:
  explicit Writer(std::vector<std::byte>& out) : out_(out) {}

  void bytes(const void* data, std::size_t size);
  void zeros(std::size_t size) { out_.resize(out_.size() + size); }
  void u8(std::uint8_t v) { bytes(&v, sizeof v); }
  void u16(std::uint16_t v) { bytes(&v, sizeof v); }
  void u32(std::uint32_t v) { bytes(&v, sizeof v); }
  void u64(std::uint64_t v) { bytes(&v, sizeof v); }
  void i32(std::int32_t v) { bytes(&v, sizeof v); }
  void i64(std::int64_t v) { bytes(&v, sizeof v); }
  void f64(double v) { bytes(&v, sizeof v); }
  void string(std::string_view s);
  void strings(std::span<const std::string> list);
  template <class T>
  void list(std::span<const T> values)
  {
    u64(values.size());
    bytes(values.data(), values.size_bytes());
  }

private:
  std::vector<std::byte>& out_;
};

/// Reads values back; `what` names the message in errors, e.g. "MESH #2 from 'solid'".
/// Every size is compared with the bytes that are left before anything is allocated.
/// All members throw ProtocolError(37).
class Reader
{
public:
  Reader(std::span<const std::byte> bytes, std::string what) : rest_(bytes), what_(std::move(what)) {}

  std::uint8_t u8(const char* field) { return number<std::uint8_t>(field); }
  std::uint16_t u16(const char* field) { return number<std::uint16_t>(field); }
  std::uint32_t u32(const char* field) { return number<std::uint32_t>(field); }
  std::uint64_t u64(const char* field) { return number<std::uint64_t>(field); }
  std::int32_t i32(const char* field) { return number<std::int32_t>(field); }
  std::int64_t i64(const char* field) { return number<std::int64_t>(field); }
  double f64(const char* field);   ///< finite
  bool boolean(const char* field); ///< 0 or 1
  std::string string(const char* field);
  std::vector<std::string> strings(const char* field);
  std::vector<std::int64_t> i64_list(const char* field) { return list<std::int64_t>(field); }
  std::vector<std::int32_t> i32_list(const char* field) { return list<std::int32_t>(field); }
  std::vector<double> f64_list(const char* field); ///< finite
  void bytes(const char* field, void* target, std::size_t size);

  std::size_t left() const { return rest_.size(); }
  void end(); ///< nothing may be left
  /// Throws: "`what`: `field` is `came`, expected `expected`".
  [[noreturn]] void reject(const std::string& field, const std::string& came,
                           const std::string& expected) const;

private:
  template <class T>
  T number(const char* field)
  {
    T v{};
    bytes(field, &v, sizeof v);
    return v;
  }
  template <class T>
  std::vector<T> list(const char* field)
  {
    const std::size_t n = count(field, sizeof(T));
    std::vector<T> values(n);
    bytes(field, values.data(), n * sizeof(T));
    return values;
  }
  std::size_t count(const char* field, std::size_t item_size);

  std::span<const std::byte> rest_;
  std::string what_;
};

/// Position of the first number that is NaN or infinite, or values.size().
std::size_t first_not_finite(std::span<const double> values);

/// Starts a message in `out`: a header's worth of room, to be followed by the payload and seal().
void begin(std::vector<std::byte>& out);

/// Writes the header over the room left by begin(), with payload size and CRC.
void seal(std::vector<std::byte>& out, Header header);

/// Checks size, magic, payload size and CRC. `from` names the sender; `expected` gives words for the message
/// wanted now and is called only for an error, so that a good message costs no allocation.
/// @throws ProtocolError(37)
Header open(std::span<const std::byte> message, const std::string& from,
            const std::function<std::string()>& expected);

inline std::span<const std::byte> payload(std::span<const std::byte> message)
{
  return message.subspan(header_size);
}

/// Answer to a MESH.
struct MeshReply
{
  bool accepted = true;
  std::string reason; ///< why not
};

/// Last word of a program.
struct Failed
{
  int code = 1; ///< its exit code
  std::string text;
};

inline constexpr std::size_t longest_failure_text = 1024; ///< [bytes]

// Payload of each type. A read_... consumes all of the payload and also checks meaning (sizes that fit,
// positions in range).
void write(Writer&, const Setup&);
void write(Writer&, const SurfaceMesh&);
void write(Writer&, const MeshReply&);
void write(Writer&, const Report&);
void write(Writer&, const Window&);
void write(Writer&, const Kinematics&);
void write(Writer&, const Activation&);
void write(Writer&, const Motion&);
void write(Writer&, const CheckpointOrder&);
void write(Writer&, const CheckpointDone&);
void write(Writer&, const Failed&);
void write(Writer&, const std::string& reason); ///< STOP_REQUEST and BYE

Setup read_setup(Reader);
SurfaceMesh read_surface_mesh(Reader);
MeshReply read_mesh_reply(Reader);
Report read_report(Reader);
Window read_window(Reader);
Kinematics read_kinematics(Reader, std::size_t size); ///< both vectors must have `size` numbers
Activation read_activation(Reader, std::size_t size); ///< both vectors must have `size` numbers
Motion read_motion(Reader, std::size_t size);         ///< both vectors must have `size` numbers
CheckpointOrder read_checkpoint_order(Reader);
CheckpointDone read_checkpoint_done(Reader);
Failed read_failed(Reader);
std::string read_reason(Reader); ///< STOP_REQUEST and BYE

} // namespace undine::link::wire
