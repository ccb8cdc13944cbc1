// One mpirun per script.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conform/launch.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace undine::link::conform
{
namespace
{

struct Ended
{
  int code = 0; ///< as a shell counts; -1: had to be killed
  std::string text;
};

std::string read_file(const std::filesystem::path& path)
{
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// Runs a command in a process group of its own; kills the group after `limit` seconds.
Ended run(const std::vector<std::string>& words, const std::filesystem::path& log, double limit)
{
  std::vector<char*> arguments;
  for (const auto& word : words)
    arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t child = fork();
  if (child == 0)
  {
    setpgid(0, 0);
    const int file = ::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
    const int nothing = ::open("/dev/null", O_RDONLY);
    dup2(nothing, STDIN_FILENO);
    dup2(file, STDOUT_FILENO);
    dup2(file, STDERR_FILENO);
    execvp(arguments[0], arguments.data());
    std::fprintf(stderr, "error: cannot start %s\n", arguments[0]);
    _exit(127);
  }
  const auto start = std::chrono::steady_clock::now();
  int status = 0;
  bool killed = false;
  while (waitpid(child, &status, WNOHANG) == 0)
  {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (seconds > limit && !killed)
    {
      kill(-child, SIGTERM); // mpirun takes its programs along
      killed = true;
    }
    else if (seconds > limit + 3.0)
      kill(-child, SIGKILL);
    usleep(10000);
  }
  Ended ended{.text = read_file(log)};
  ended.code = killed ? -1 : WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return ended;
}

struct Tally
{
  int kept = 0;
  int broken = 0;

  void say(const std::string& verdict, const std::string& clause, const std::string& text)
  {
    std::printf("  %-4s  %-5s  %s\n", verdict.c_str(), clause.c_str(), text.c_str());
    std::fflush(stdout);
    kept += verdict == "pass";
    broken += verdict == "FAIL";
  }
};

void judge_end(const Script& script, const Ended& ended, Tally& tally)
{
  if (ended.code == -1)
    tally.say("FAIL", script.code_clause, "the run had not ended at the limit");
  else if (ended.code == not_noticed)
    tally.say("FAIL", script.code_clause, "the program did not end although it should have");
  else if (script.expected_code == -1)
    tally.say(ended.code != 0 ? "pass" : "FAIL", script.code_clause,
              "ends with an error (exit code " + std::to_string(ended.code) + ")");
  else
    tally.say(ended.code == script.expected_code ? "pass" : "FAIL", script.code_clause,
              "ends with exit code " + std::to_string(script.expected_code) +
                  (ended.code == script.expected_code ? "" : ", not " + std::to_string(ended.code)));
}

} // namespace

int run_all(const Options& options, const char* self)
{
  char name[] = "/tmp/undine_conform_XXXXXX";
  if (mkdtemp(name) == nullptr)
  {
    std::fprintf(stderr, "error: undine-conform: cannot make a folder in /tmp\n");
    return 2;
  }
  const std::filesystem::path folder = name;
  setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
  setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);

  Tally tally;
  for (const Script& script : scripts())
  {
    if (script.name.find(options.only) == std::string::npos ||
        (script.name == "silent coupler" && options.stall <= 0.0))
      continue;
    std::printf("%s: %s\n", script.name.c_str(), script.purpose.c_str());
    std::fflush(stdout);
    std::vector<std::string> line{"mpirun",    "--oversubscribe",
                                  "--bind-to", "none",
                                  "--mca",     "mpi_yield_when_idle",
                                  "1",         "-n",
                                  "1",         self,
                                  "--play",    script.name,
                                  "--folder",  folder.string(),
                                  "--role",    options.role,
                                  "--dim",     std::to_string(options.dim),
                                  "--ranks",   std::to_string(options.ranks),
                                  "--limit",   std::to_string(options.limit),
                                  "--stall",   std::to_string(options.stall)};
    for (const auto& interface : options.interfaces)
      line.insert(line.end(), {"--interface", interface});
    line.insert(line.end(), {":", "-n", std::to_string(options.ranks)});
    line.insert(line.end(), options.program.begin(), options.program.end());

    const auto findings = folder / "findings";
    std::filesystem::remove(findings);
    std::filesystem::remove(folder / not_applicable);
    const Ended ended = run(line, folder / "log", options.limit + options.stall + 5.0);

    std::ifstream in(findings);
    for (std::string verdict, clause, text;
         std::getline(in, verdict, '\t') && std::getline(in, clause, '\t') && std::getline(in, text);)
      tally.say(verdict, clause, text);
    const int broken_before = tally.broken;
    if (std::filesystem::exists(folder / not_applicable))
      tally.say("note", "1", "not for a program that does not offer it");
    else
      judge_end(script, ended, tally);
    if (options.verbose || tally.broken > broken_before)
      std::printf("%s\n", ended.text.c_str());
  }
  std::filesystem::remove_all(folder);
  std::printf("%d rules kept, %d broken\n", tally.kept, tally.broken);
  return tally.broken == 0 && tally.kept > 0 ? 0 : 1;
}

} // namespace undine::link::conform
