// FAILED.toml, and the end of all programs.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/failure.hpp"

#include "common/coupling/own_process.hpp"
#include "common/coupling/start_timer.hpp"

#include <mpi.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <cstdlib>

namespace undine::link
{
namespace
{

std::string toml_string(const std::string& text)
{
  static const std::string escaped = "\"\\\n\t\r", letters = "\"\\ntr";
  std::string quoted = "\"";
  for (const char c : text)
    if (const auto k = escaped.find(c); k != std::string::npos)
      quoted += std::string("\\") + letters[k];
    else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F)
    {
      char code[8];
      std::snprintf(code, sizeof code, "\\u%04X", static_cast<unsigned>(static_cast<unsigned char>(c)));
      quoted += code;
    }
    else
      quoted += c;
  return quoted + "\"";
}

/// The number behind `name` ("step 12", "t = 0.5 s") as it stands in the text, or nothing.
std::string number_after(const std::string& text, const std::string& name, bool with_equal_sign)
{
  for (std::size_t at = text.find(name); at != std::string::npos; at = text.find(name, at + 1))
  {
    if (at > 0 && (std::isalnum(static_cast<unsigned char>(text[at - 1])) != 0 || text[at - 1] == '_'))
      continue;
    std::size_t i = at + name.size();
    while (i < text.size() && text[i] == ' ')
      ++i;
    if (with_equal_sign)
    {
      if (i >= text.size() || text[i] != '=')
        continue;
      ++i;
      while (i < text.size() && text[i] == ' ')
        ++i;
    }
    char* end = nullptr;
    std::strtod(text.c_str() + i, &end);
    std::string number(text.c_str() + i, static_cast<const char*>(end));
    if (!number.empty() && (std::isdigit(static_cast<unsigned char>(number[0])) != 0 || number[0] == '-'))
      return number;
  }
  return {};
}

/// When this process started, before main().
const time_t process_start = time(nullptr);

/// A file of an earlier run in the same folder. The programs of one run start within seconds of each other.
bool is_stale(const std::string& path)
{
  struct stat status
  {
  };
  return stat(path.c_str(), &status) == 0 && status.st_mtime < process_start - 10;
}

/// Writes FAILED.toml whole or not at all, and never over that of a program of this run that failed earlier.
void write_failed(const std::string& out_dir, int code, const std::string& role, int rank,
                  const std::string& text)
{
  std::string content = "# Why the run ended.\n";
  content += "code = " + std::to_string(code) + "\n";
  content += "program = " + toml_string(role) + "\n";
  content += "rank = " + std::to_string(rank) + "\n";
  content += "host = " + toml_string(host_name()) + "\n";
  content += "pid = " + std::to_string(getpid()) + "\n";
  if (const std::string step = number_after(text, "step", false); !step.empty())
    content += "step = " + step + "\n";
  if (const std::string time = number_after(text, "t", true); !time.empty())
    content += "time = " + time + "\n";
  content += "text = " + toml_string(text) + "\n";

  mkdir(out_dir.c_str(), 0777); // an error before the output folder was made
  const std::string target = out_dir + "/FAILED.toml";
  const std::string temporary = target + "." + std::to_string(getpid());
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0)
    return; // the message on stderr must do
  const bool complete =
      ::write(file, content.data(), content.size()) == static_cast<ssize_t>(content.size()) &&
      fsync(file) == 0;
  close(file);
  // link() refuses to replace, rename() does not; some file systems have no links.
  if (complete && (is_stale(target) ||
                   (::link(temporary.c_str(), target.c_str()) != 0 && access(target.c_str(), F_OK) != 0)))
    rename(temporary.c_str(), target.c_str());
  unlink(temporary.c_str());
}

} // namespace

double courtesy_of(int position) { return position == 0 ? 0.0 : 0.3 + 0.1 * std::min(position, 20); }

void abort_world(int code, const std::string& role, const std::string& text, const std::string& out_dir)
{
  disarm_start_timer();
  const bool running = mpi_is_running();
  int rank = rank_from_launcher();
  if (running)
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);

  // Others may see the same error, or hear of it from us; whoever speaks first ends all, so this wait is
  // rarely slept through.
  const double leave = courtesy.load() >= 0.0 ? courtesy.load() : courtesy_of(rank);
  const double announced = failure_announced ? 5.0 : 0.0;
  if (std::max(leave, announced) > 0.0)
    sleep_for(std::max(leave, announced));

  std::fflush(nullptr);
  print("error: " + text + "\n       (" + role + ", world rank " + std::to_string(rank) + " on " +
        host_name() + ", exit code " + std::to_string(code) + ")\n");
  if (!out_dir.empty())
    write_failed(out_dir, code, role, rank, text);
  if (running)
    MPI_Abort(MPI_COMM_WORLD, code);
  // Before MPI_Init the launcher ends the others when it sees this code.
  std::_Exit(code);
}

void report_failure(int code, const std::string& role, const std::string& text, const std::string& out_dir)
{
  disarm_start_timer();
  print("error: " + text + "\n");
  if (!out_dir.empty())
    write_failed(out_dir, code, role, rank_from_launcher(), text);
}

} // namespace undine::link
