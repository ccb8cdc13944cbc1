// The buffers and lists of a halo.
#include "common/parallel/halo.hpp"

#include <algorithm>

namespace undine
{

void Halo::allocate(std::size_t row_bytes)
{
  row_bytes_ = row_bytes;
  out_.resize(send_.size());
  in_.resize(receive_.size());
  for (std::size_t r = 0; r < send_.size(); ++r)
  {
    out_[r].resize(send_[r].size() * row_bytes);
    in_[r].resize(receive_[r].size() * row_bytes);
  }
}

void Halo::send()
{
  std::vector<Ranks::Part> sends, receives;
  for (std::size_t r = 0; r < send_.size(); ++r)
  {
    if (!in_[r].empty())
      receives.push_back({static_cast<int>(r), in_[r].data(), in_[r].size()});
    if (!out_[r].empty())
      sends.push_back({static_cast<int>(r), out_[r].data(), out_[r].size()});
  }
  messages_ = ranks_.start(sends, receives);
}

void Halo::renumber(std::span<const index_t> new_number)
{
  for (auto* lists : {&send_, &receive_})
    for (auto& list : *lists)
    {
      for (index_t& n : list)
        n = new_number[static_cast<std::size_t>(n)];
      std::erase(list, -1);
    }
}

void Halo::keep(const std::vector<char>& needed)
{
  if (ranks_.alone())
    return;
  std::vector<std::vector<char>> wanted(receive_.size());
  for (std::size_t r = 0; r < receive_.size(); ++r)
  {
    for (const index_t n : receive_[r])
      wanted[r].push_back(needed[static_cast<std::size_t>(n)]);
    std::erase_if(receive_[r], [&](index_t n) { return !needed[static_cast<std::size_t>(n)]; });
  }
  wanted = ranks_.exchange(wanted);
  for (std::size_t r = 0; r < send_.size(); ++r)
  {
    std::size_t kept = 0;
    for (std::size_t k = 0; k < send_[r].size(); ++k)
      if (wanted[r][k])
        send_[r][kept++] = send_[r][k];
    send_[r].resize(kept);
  }
}

} // namespace undine
