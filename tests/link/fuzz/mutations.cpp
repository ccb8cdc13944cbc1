// Feeds the fuzz target with mutations of good messages, reproducibly, where libFuzzer is not at hand; also
// writes the good messages as a corpus for libFuzzer.
//
//   fuzz_decoder SECONDS            mutate for so long
//   fuzz_decoder --corpus FOLDER    write the seeds
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <random>
#include <string>
#include <vector>

namespace golden
{
#include "tests/link/golden_messages.inc"
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace
{

using Input = std::vector<std::uint8_t>;

Input from_hex(const std::string& hex)
{
  Input bytes;
  for (std::size_t k = 0; k + 1 < hex.size(); k += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(k, 2), nullptr, 16)));
  return bytes;
}

/// The payload of a golden message behind the number of its decoder.
Input payload(std::uint8_t which, const char* hex)
{
  Input input = from_hex(hex);
  input.erase(input.begin(), input.begin() + 63);
  input[0] = which;
  return input;
}

/// Something whole behind the number of its decoder.
Input whole(std::uint8_t which, const char* hex)
{
  Input input = from_hex(hex);
  input.insert(input.begin(), which);
  return input;
}

void add_message(Input& input, std::uint8_t type, const Input& bytes)
{
  input.push_back(type);
  input.push_back(static_cast<std::uint8_t>(bytes.size() & 0xFF));
  input.push_back(static_cast<std::uint8_t>(bytes.size() >> 8));
  input.insert(input.end(), bytes.begin(), bytes.end());
}

Input body(const char* hex)
{
  Input bytes = from_hex(hex);
  bytes.erase(bytes.begin(), bytes.begin() + 64);
  return bytes;
}

/// What three owners of a row each say to the coupler in three windows.
Input owners()
{
  Input ready = body(golden::ready), of_first, of_others;
  ready.back() = 0; // the surface stays
  add_message(of_first, 2, body(golden::mesh_of_several_ranks));
  add_message(of_first, 4, ready);
  for (int window = 0; window < 3; ++window)
  {
    for (Input* of_rank : {&of_first, &of_others})
    {
      add_message(*of_rank, 16, body(golden::kinematics));
      add_message(*of_rank, 6, Input(2 * sizeof(double), 0));
    }
    add_message(of_first, 4, ready);
  }
  add_message(of_first, 13, {});
  Input input{16, static_cast<std::uint8_t>(of_first.size() & 0xFF),
              static_cast<std::uint8_t>(of_first.size() >> 8)};
  input.insert(input.end(), of_first.begin(), of_first.end());
  input.insert(input.end(), of_others.begin(), of_others.end());
  return input;
}

/// SETUP, MESH_REPLY, CHECKPOINT, WINDOW and what it asks for, BYE as a conversation.
/// @param bits  of the window: 1 fine, 2 trial, 4 flight
Input conversation(std::uint8_t bits)
{
  Input input{15};
  const auto add = [&input](std::uint8_t type, const Input& bytes) { add_message(input, type, bytes); };
  Input reply{1, 0, 0, 0, 0};
  Input window = body(golden::window);
  window[24] = 1; // one step,
  window[32] = bits;
  window[33] = 1; // an activation
  Input vector(6 * sizeof(double), 0);
  Input lists(2 * (8 + 6 * sizeof(double)), 0);
  lists[0] = lists[8 + 6 * sizeof(double)] = 6;
  add(1, body(golden::setup));
  add(3, reply);
  add(9, body(golden::checkpoint));
  add(5, window);
  add(17, lists);
  if ((bits & 4) == 0)
    add(7, vector);
  add(15, {});
  add(12, body(golden::bye));
  return input;
}

std::vector<Input> seeds()
{
  using namespace golden;
  return {payload(0, setup),
          payload(1, mesh),
          payload(1, mesh_of_a_thin_wall),
          payload(1, mesh_of_several_ranks),
          owners(),
          payload(2, motion),
          payload(3, mesh_reply),
          payload(4, ready),
          payload(5, window),
          payload(6, checkpoint),
          payload(7, kinematics),
          payload(8, checkpoint_done),
          payload(9, activation_impulse),
          payload(10, fail),
          payload(11, bye),
          payload(11, stop_request),
          whole(12, hello),
          whole(13, roster),
          whole(13, roster_with_error),
          whole(14, link_force),
          whole(14, mesh),
          payload(5, window_on_trial),
          payload(5, window_in_flight),
          conversation(1),
          conversation(3),
          conversation(5)};
}

void mutate(Input& input, std::mt19937_64& random)
{
  const auto below = [&random](std::size_t n) { return static_cast<std::size_t>(random() % n); };
  for (std::size_t changes = 1 + below(4); changes > 0 && !input.empty(); --changes)
    switch (below(6))
    {
    case 0: // a bit
      input[below(input.size())] ^= static_cast<std::uint8_t>(1u << below(8));
      break;
    case 1: // a byte that is often at the edge of something
    {
      constexpr std::uint8_t edge[] = {0, 1, 2, 3, 0x7F, 0x80, 0xF0, 0xFF};
      input[below(input.size())] = edge[below(8)];
      break;
    }
    case 2: // a shorter message
      input.resize(1 + below(input.size()));
      break;
    case 3: // a longer one
      input.insert(input.end(), below(16), static_cast<std::uint8_t>(random()));
      break;
    case 4: // a count of eight bytes
      if (input.size() > 9)
      {
        constexpr std::uint64_t count[] = {0, 1, 1ull << 31, 1ull << 32, 1ull << 60, 1ull << 61, ~0ull};
        std::memcpy(input.data() + 1 + below(input.size() - 9), &count[below(7)], sizeof count[0]);
      }
      break;
    default: // a piece doubled or gone
    {
      const std::size_t from = below(input.size()), length = below(input.size() - from + 1);
      const Input piece(input.begin() + static_cast<std::ptrdiff_t>(from),
                        input.begin() + static_cast<std::ptrdiff_t>(from + length));
      if (below(2) == 0 && input.size() < 4096)
        input.insert(input.begin() + static_cast<std::ptrdiff_t>(from), piece.begin(), piece.end());
      else
        input.erase(input.begin() + static_cast<std::ptrdiff_t>(from),
                    input.begin() + static_cast<std::ptrdiff_t>(from + length));
    }
    }
}

} // namespace

int main(int argc, char** argv)
{
  const auto start_inputs = seeds();
  if (argc == 3 && std::strcmp(argv[1], "--corpus") == 0)
  {
    for (std::size_t k = 0; k < start_inputs.size(); ++k)
      std::ofstream(std::string(argv[2]) + "/seed" + std::to_string(k), std::ios::binary)
          .write(reinterpret_cast<const char*>(start_inputs[k].data()),
                 static_cast<std::streamsize>(start_inputs[k].size()));
    return 0;
  }
  const double seconds = argc > 1 ? std::atof(argv[1]) : 30.0;
  for (const Input& seed : start_inputs)
    LLVMFuzzerTestOneInput(seed.data(), seed.size());
  std::mt19937_64 random(20171);
  const auto start = std::chrono::steady_clock::now();
  long long executions = 0;
  while (std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() < seconds)
    for (int k = 0; k < 1000; ++k, ++executions)
    {
      Input input = start_inputs[static_cast<std::size_t>(random() % start_inputs.size())];
      mutate(input, random);
      LLVMFuzzerTestOneInput(input.data(), input.size());
    }
  std::printf("%lld mutated messages, nothing found\n", executions);
  return 0;
}
