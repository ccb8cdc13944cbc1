// std::source_location for clang 14, which cannot compile that of GCC's library; included before everything
// else by the fuzzers' command line.
#pragma once

#if !__has_builtin(__builtin_source_location)
namespace std // NOLINT: stands in for the missing header
{
struct source_location
{
  static constexpr source_location current(const char* file = __builtin_FILE(),
                                           unsigned line = __builtin_LINE())
  {
    source_location where;
    where.file_ = file;
    where.line_ = line;
    return where;
  }
  constexpr const char* file_name() const { return file_; }
  constexpr unsigned line() const { return line_; }

private:
  const char* file_ = "";
  unsigned line_ = 0;
};
} // namespace std
#endif
