// Per-program log file.
#include "common/io/log.hpp"

#include "common/error.hpp"
#include "common/io/folder.hpp"

#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>

namespace undine
{

std::shared_ptr<spdlog::logger> make_log(const std::string& out_dir, const std::string& role,
                                         bool on_terminal)
{
  make_folder(out_dir);
  std::vector<spdlog::sink_ptr> sinks;
  try
  {
    sinks.push_back(std::make_shared<spdlog::sinks::basic_file_sink_mt>(out_dir + "/" + role + ".log", true));
  }
  catch (const spdlog::spdlog_ex& error)
  {
    throw Failure(ExitCode::output_failed, out_dir + "/" + role + ".log: cannot be written: " + error.what());
  }
  if (on_terminal)
    sinks.push_back(std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  auto log = std::make_shared<spdlog::logger>(role, sinks.begin(), sinks.end());
  log->set_pattern("%Y-%m-%d %H:%M:%S.%e %n %^%l%$: %v");
  log->flush_on(spdlog::level::info); // the log of a run that is killed must be complete
  return log;
}

std::shared_ptr<spdlog::logger> no_log() { return std::make_shared<spdlog::logger>("none"); }

} // namespace undine
