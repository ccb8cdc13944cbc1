// Copies of other ranks' nodes, and how they are kept up to date.
#pragma once

#include "common/parallel/ranks.hpp"
#include "common/types.hpp"

#include <cstddef>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

namespace undine
{

/// A rank computes what belongs to the nodes it owns and holds copies (ghosts) of some of its neighbours'.
/// update() overwrites the ghosts' rows of fields with those of their owners. Nothing is ever added up across
/// ranks: whoever owns a node knows all that touches it.
class Halo
{
public:
  /// No ghosts.
  Halo() = default;
  /// send[r]: owned nodes that rank r has copies of; receive[r]: the copies here of nodes of rank r, in the
  /// order in which r has them in its send list for this rank.
  Halo(const Ranks& ranks, std::vector<std::vector<index_t>> send, std::vector<std::vector<index_t>> receive)
      : ranks_(ranks), send_(std::move(send)), receive_(std::move(receive))
  {
  }

  const std::vector<std::vector<index_t>>& sent() const { return send_; }
  const std::vector<std::vector<index_t>>& received() const { return receive_; }

  /// Bring fields (vectors with a row per node) up to date on all ghosts. Collective.
  template <class... Field>
  void update(Field&... fields)
  {
    if (ranks_.alone())
      return;
    start(fields...);
    finish(fields...);
  }
  /// The same in two parts, with work in between that neither reads ghosts nor writes sent nodes.
  template <class... Field>
  void start(const Field&... fields)
  {
    if (ranks_.alone())
      return;
    const Ranks::Clock clock(ranks_, &Ranks::Cost::halo);
    constexpr std::size_t row = (sizeof(typename Field::value_type) + ...);
    allocate(row);
    for (std::size_t r = 0; r < send_.size(); ++r)
    {
      std::byte* to = out_[r].data();
      for (const index_t n : send_[r])
        (pack(fields[static_cast<std::size_t>(n)], to), ...);
    }
    send();
  }
  template <class... Field>
  void finish(Field&... fields)
  {
    if (ranks_.alone())
      return;
    const Ranks::Clock clock(ranks_, &Ranks::Cost::halo);
    ranks_.wait(*messages_);
    for (std::size_t r = 0; r < receive_.size(); ++r)
    {
      const std::byte* from = in_[r].data();
      for (const index_t n : receive_[r])
        (unpack(fields[static_cast<std::size_t>(n)], from), ...);
    }
  }

  /// Node n is now new_number[n]; −1: it is gone, on the owner and on all ranks with copies.
  void renumber(std::span<const index_t> new_number);
  /// Forget the copies that are not `needed` here; their owners stop to send them. Collective.
  void keep(const std::vector<char>& needed);

private:
  template <class T>
  static void pack(const T& value, std::byte*& to)
  {
    static_assert(std::is_trivially_copyable_v<T>);
    std::memcpy(to, &value, sizeof(T));
    to += sizeof(T);
  }
  template <class T>
  static void unpack(T& value, const std::byte*& from)
  {
    std::memcpy(&value, from, sizeof(T));
    from += sizeof(T);
  }
  void allocate(std::size_t row_bytes);
  void send();

  Ranks ranks_;
  std::vector<std::vector<index_t>> send_, receive_;
  std::vector<std::vector<std::byte>> out_, in_;
  std::size_t row_bytes_ = 0;
  std::shared_ptr<Ranks::Messages> messages_;
};

} // namespace undine
