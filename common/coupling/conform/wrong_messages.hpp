// Messages that a program must refuse.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "common/coupling/conform/scripts.hpp"
#include "common/coupling/link.hpp"
#include "common/coupling/wire.hpp"

#include <cstring>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace undine::link::conform
{

/// Changes one outgoing message, to see whether the program notices.
class TamperingChannel final : public Channel
{
public:
  using Tamper = std::function<void(std::vector<std::byte>&)>;
  /// @param which  the n-th message of `type`, from 1
  TamperingChannel(std::unique_ptr<Channel> channel, MessageType type, int which, Tamper tamper)
      : channel_(std::move(channel)), type_(type), left_(which), tamper_(std::move(tamper))
  {
  }
  void send(std::span<const std::byte> message) override
  {
    std::uint16_t type = 0;
    std::memcpy(&type, message.data() + 4, sizeof type);
    if (tamper_ && type == static_cast<std::uint16_t>(type_) && --left_ == 0)
    {
      std::vector<std::byte> changed(message.begin(), message.end());
      tamper_(changed);
      channel_->send(changed);
    }
    else
      channel_->send(message);
  }
  void receive(std::vector<std::byte>& message) override { channel_->receive(message); }

private:
  std::unique_ptr<Channel> channel_;
  MessageType type_;
  int left_;
  Tamper tamper_;
};

/// A wrong message: which one, and what is done to it.
struct Wrong
{
  MessageType type;
  int which;
  TamperingChannel::Tamper tamper;
};

/// Every script with a wrong message.
const std::vector<std::pair<Script, Wrong>>& wrong_messages();

} // namespace undine::link::conform
