// Folders and manifests of checkpoints.
#include "common/io/checkpoint.hpp"

#include "common/coupling/wire.hpp"
#include "common/error.hpp"
#include "common/io/folder.hpp"
#include "common/io/stop_signal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <span>
#include <sstream>

namespace undine
{

namespace
{

namespace fs = std::filesystem;

std::optional<std::string> content_of(const fs::path& path)
{
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (!file || !(text << file.rdbuf()))
    return std::nullopt;
  return text.str();
}

/// Size and checksum of a file, if it can be read.
std::optional<Manifest::File> measured(const fs::path& folder, const std::string& name)
{
  std::ifstream file(folder / name, std::ios::binary);
  Manifest::File found{.name = name};
  std::vector<char> piece(std::size_t{1} << 20);
  while (file)
  {
    file.read(piece.data(), static_cast<std::streamsize>(piece.size()));
    const auto bytes = std::as_bytes(std::span(piece)).first(static_cast<std::size_t>(file.gcount()));
    found.crc32c = link::wire::crc32c(bytes, found.crc32c);
    found.bytes += bytes.size();
  }
  return file.eof() ? std::optional(found) : std::nullopt;
}

/// The value after "key = " on a line, without quotation marks.
std::string value_of(const std::string& line)
{
  std::string value = line.substr(line.find('=') + 1);
  const auto begin = value.find_first_not_of(" \""), end = value.find_last_not_of(" \"\r");
  return begin == std::string::npos ? "" : value.substr(begin, end - begin + 1);
}

Manifest parse(const std::string& text)
{
  Manifest manifest;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
  {
    const std::string key = line.substr(0, line.find(' '));
    if (key == "[[file]]")
      manifest.files.emplace_back();
    else if (key == "t")
      manifest.t = std::stod(value_of(line));
    else if (key == "window")
      manifest.window = std::stoll(value_of(line));
    else if (key == "case_hash")
      manifest.case_hash = value_of(line);
    else if (key == "name" && !manifest.files.empty())
      manifest.files.back().name = value_of(line);
    else if (key == "bytes" && !manifest.files.empty())
      manifest.files.back().bytes = std::stoull(value_of(line));
    else if (key == "crc32c" && !manifest.files.empty())
      manifest.files.back().crc32c = static_cast<std::uint32_t>(std::stoul(value_of(line), nullptr, 16));
  }
  return manifest;
}

/// The checkpoint in `folder`; otherwise `complaint` says why there is none.
std::optional<Checkpoint> open_checkpoint(const fs::path& folder, std::string& complaint)
{
  const auto text = content_of(folder / "manifest.toml");
  if (!text)
  {
    complaint = "there is no manifest.toml, so it was never completed";
    return std::nullopt;
  }
  Checkpoint checkpoint{.folder = folder.string(), .manifest = {}};
  try
  {
    checkpoint.manifest = parse(*text);
  }
  catch (const std::exception&)
  {
    complaint = "manifest.toml is damaged";
    return std::nullopt;
  }
  if (checkpoint.manifest.files.empty())
    complaint = "manifest.toml names no files";
  for (const Manifest::File& file : checkpoint.manifest.files)
  {
    const auto found = measured(folder, file.name);
    if (!found)
      complaint = file.name + " is missing";
    else if (found->bytes != file.bytes || found->crc32c != file.crc32c)
      complaint = file.name + " has another size or checksum than manifest.toml says";
  }
  if (!complaint.empty())
    return std::nullopt;
  return checkpoint;
}

/// Folders in `<out_dir>/checkpoints`, newest first.
std::vector<fs::path> folders(const std::string& out_dir)
{
  std::vector<fs::path> found;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(fs::path(out_dir) / "checkpoints", ignored))
    if (entry.is_directory(ignored))
      found.push_back(entry.path());
  std::sort(found.rbegin(), found.rend());
  return found;
}

} // namespace

Checkpoint find_checkpoint(const std::string& out_dir, const std::string& which)
{
  std::string complaint;
  if (which != "latest")
  {
    const fs::path inside = fs::path(out_dir) / "checkpoints" / which;
    const fs::path folder = fs::is_directory(inside) ? inside : fs::path(which);
    if (auto checkpoint = open_checkpoint(folder, complaint))
      return *checkpoint;
    throw InputError(fmt::format("--restart {}: {}: {}", which, folder.string(), complaint),
                     ExitCode::bad_input_file);
  }
  std::string all;
  for (const fs::path& folder : folders(out_dir))
  {
    complaint.clear();
    if (auto checkpoint = open_checkpoint(folder, complaint))
      return *checkpoint;
    all += fmt::format("\n       {}: {}", folder.filename().string(), complaint);
  }
  throw InputError(
      fmt::format("--restart latest: {}/checkpoints holds no complete checkpoint{}", out_dir, all),
      ExitCode::bad_input_file);
}

Checkpoints::Checkpoints(const CheckpointConfig& config, std::string out_dir, std::string case_hash)
    : config_(config), out_dir_(std::move(out_dir)), case_hash_(std::move(case_hash)),
      begin_(std::chrono::steady_clock::now()), last_(begin_)
{
  next_ = config_.every;
}

void Checkpoints::continue_from(double t)
{
  if (config_.every > 0.0)
    next_ = config_.every * (std::floor(t / config_.every) + 1.0);
}

std::string Checkpoints::stop_reason() const
{
  if (const std::string name = stop_signal(); !name.empty())
    return "received " + name;
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begin_;
  if (config_.wall_limit > 0.0 && wall.count() >= config_.wall_limit)
    return fmt::format("checkpoint.wall_limit = {:g} s is over", config_.wall_limit);
  return "";
}

bool Checkpoints::due(double t) const { return config_.every > 0.0 && t >= next_; }

bool Checkpoints::due_now() const
{
  const std::chrono::duration<double> since = std::chrono::steady_clock::now() - last_;
  return (config_.every_wall > 0.0 && since.count() >= config_.every_wall) || !stop_reason().empty();
}

void Checkpoints::passed(double t)
{
  while (config_.every > 0.0 && next_ <= t)
    next_ = config_.every * (std::floor(t / config_.every) + 1.0);
  last_ = std::chrono::steady_clock::now();
}

std::string Checkpoints::begin()
{
  const auto present = folders(out_dir_);
  std::int64_t number = 0;
  for (const fs::path& folder : present)
    number = std::max<std::int64_t>(number, std::strtoll(folder.filename().c_str(), nullptr, 10) + 1);
  const std::string folder = fmt::format("{}/checkpoints/{:06}", out_dir_, number);
  make_folder(folder);
  return folder;
}

void Checkpoints::finish(const std::string& folder, double t, std::int64_t window,
                         const std::vector<std::string>& files)
{
  std::string text =
      fmt::format("# A checkpoint of Undine {}: complete, because this file was written last.\n"
                  "t = {:.17g}\nwindow = {}\ncase_hash = \"{}\"\n",
                  UNDINE_VERSION, t, window, case_hash_);
  for (const std::string& name : files)
  {
    const auto found = measured(folder, name);
    if (!found)
      throw Failure(ExitCode::output_failed, fmt::format("{}/{}: cannot be read back", folder, name));
    text += fmt::format("\n[[file]]\nname = \"{}\"\nbytes = {}\ncrc32c = \"{:08x}\"\n", name, found->bytes,
                        found->crc32c);
  }
  replace_file(folder + "/manifest.toml", text, true);
  passed(t);

  std::int64_t complete = 0;
  for (const fs::path& old : folders(out_dir_))
    if (config_.keep > 0 && complete >= config_.keep)
      abandon(old.string());
    else
      complete += fs::exists(old / "manifest.toml");
}

void Checkpoints::abandon(const std::string& folder)
{
  std::error_code ignored;
  fs::remove(fs::path(folder) / "manifest.toml", ignored); // first: half a checkpoint must not look whole
  fs::remove_all(folder, ignored);
}

void Persistence::restore(const StateVisitor& state) const
{
  StateArchive archive(from->folder + "/" + file_name());
  state(archive);
  if (output)
    output(archive);
}

void Persistence::save(const std::string& folder, const StateVisitor& state) const
{
  StateArchive archive(folder + "/" + file_name(), ranks);
  state(archive);
  if (output)
    output(archive);
  archive.save();
}

std::string Persistence::after_step(double t, std::int64_t step, const StateVisitor& state) const
{
  if (checkpoints == nullptr)
    return "";
  constexpr std::int64_t ask_every = 8; // steps: clocks and signals differ between ranks
  const bool now =
      ranks.alone() ? checkpoints->due_now() : step % ask_every == 0 && ranks.any(checkpoints->due_now());
  if (!now && !checkpoints->due(t))
    return "";
  const bool first = ranks.rank() == 0;
  const std::string folder = first ? checkpoints->begin() : "";
  save(folder, state);
  if (first)
    checkpoints->finish(folder, t, step, {file_name()});
  else
    checkpoints->passed(t);
  const std::string reason = checkpoints->stop_reason();
  return ranks.any(!reason.empty()) && reason.empty() ? "another rank was told to stop" : reason;
}

} // namespace undine
