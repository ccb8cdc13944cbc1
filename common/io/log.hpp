// Per-program log file; the terminal belongs to the coupler (or to a program that runs alone).
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>

namespace undine
{

/// Log to `<out_dir>/<role>.log`, and to stderr too if `on_terminal`. Every record: wall time, role, level,
/// text.
std::shared_ptr<spdlog::logger> make_log(const std::string& out_dir, const std::string& role,
                                         bool on_terminal);
/// For the ranks that do not log.
std::shared_ptr<spdlog::logger> no_log();

} // namespace undine
