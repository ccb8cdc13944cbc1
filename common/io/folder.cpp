// Output folders and files that are replaced as a whole.
#include "common/io/folder.hpp"

#include "common/error.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

namespace undine
{

void make_folder(const std::string& path)
{
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error || !std::filesystem::is_directory(path))
    throw Failure(ExitCode::output_failed, fmt::format("{}: the output folder cannot be made: {}", path,
                                                       error ? error.message() : "a file has its name"));
}

void replace_file(const std::string& path, const std::string& text, bool to_disk)
{
  const std::string temporary = path + ".new";
  const auto fail = [&path, &temporary](const char* reason)
  {
    std::remove(temporary.c_str());
    throw Failure(ExitCode::output_failed, fmt::format("{}: cannot be written: {}", path, reason));
  };
  std::FILE* file = std::fopen(temporary.c_str(), "wb");
  if (file == nullptr)
    fail(std::strerror(errno));
  const bool written = std::fwrite(text.data(), 1, text.size(), file) == text.size() &&
                       std::fflush(file) == 0 && (!to_disk || fsync(fileno(file)) == 0);
  const int reason = errno;
  if (std::fclose(file) != 0 || !written)
    fail(std::strerror(written ? errno : reason));
  if (std::rename(temporary.c_str(), path.c_str()) != 0)
    fail(std::strerror(errno));
}

} // namespace undine
