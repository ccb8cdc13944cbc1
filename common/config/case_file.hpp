// The case file: typed, documented access to one TOML text that all programs share.
//
// Every key is described where it is read (name, unit, meaning, default, rule); docs/case-file.md is
// generated from those descriptions. Errors carry file, line, caret, rule and, for misspelt names, the
// nearest known one.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace undine
{

/// Description of a key: its name, SI unit ("" for none) and meaning in one sentence.
struct Key
{
  std::string_view name;
  std::string_view unit;
  std::string_view meaning;
};

/// A rule a number must obey and how to say it, e.g. "must be positive".
struct Rule
{
  std::function<bool(double)> holds;
  std::string text; ///< ends a sentence "fluid.density = -1: ..."
};

Rule any_number();
Rule positive();
Rule non_negative();
Rule at_least(double lower);
Rule between(double lower, double upper);          ///< closed interval
Rule strictly_between(double lower, double upper); ///< open interval

class CaseDocument; // the parsed text; case_document.hpp
namespace toml_tree
{
struct Node;
}

/// One table of the case. Cheap to copy; valid as long as its CaseFile.
/// All readers throw InputError (place, key, value, rule) and mark the key as known.
class CaseTable
{
public:
  bool present() const;                  ///< the table is written in the case
  bool has(std::string_view name) const; ///< the key is written in the case (does not mark it as known)
  const std::string& path() const;       ///< e.g. "fluid" or "interface[0]"

  double number(const Key&, const Rule&) const; ///< required
  double number(const Key&, double default_value, const Rule&) const;
  std::optional<double> optional_number(const Key&, const Rule&) const;
  std::int64_t integer(const Key&, const Rule&) const; ///< required
  std::int64_t integer(const Key&, std::int64_t default_value, const Rule&) const;
  std::optional<std::int64_t> optional_integer(const Key&, const Rule&) const;
  bool boolean(const Key&, bool default_value) const;
  std::string text(const Key&) const; ///< required
  std::string text(const Key&, std::string_view default_value) const;
  std::optional<std::string> optional_text(const Key&) const;
  /// One of `choices`; an unknown word is an error that lists them and names the nearest.
  std::string choice(const Key&, const std::vector<std::string>& choices) const; ///< required
  std::string choice(const Key&, std::string_view default_value,
                     const std::vector<std::string>& choices) const;
  /// A list of numbers; `size` > 0 demands that many.
  std::vector<double> numbers(const Key&, std::size_t size, const Rule&) const; ///< required
  std::vector<double> numbers(const Key&, std::size_t size, const std::vector<double>& default_value,
                              const Rule&) const;
  std::vector<std::string> texts(const Key&, const std::vector<std::string>& default_value) const;
  /// A key that may be a number or a text, such as substeps = "auto" | 20: the text form, or nothing if it is
  /// a number.
  bool is_text(std::string_view name) const;

  CaseTable table(std::string_view name, std::string_view meaning) const; ///< sub-table, perhaps absent
  std::vector<CaseTable> tables(std::string_view name, std::string_view meaning) const; ///< array of tables

  /// Throw an InputError that points at `name` (or at the table if `name` is absent): "<path>.<name> =
  /// <value>: <text>".
  [[noreturn]] void fail(std::string_view name, const std::string& text) const;

private:
  friend class CaseFile;
  CaseTable(std::shared_ptr<CaseDocument> document, const toml_tree::Node* node, std::string path);
  std::shared_ptr<CaseDocument> document_;
  const toml_tree::Node* node_ = nullptr; ///< the parsed table, nullptr if absent
  std::string path_;
};

/// A parsed case with its overrides.
class CaseFile
{
public:
  /// Read and parse `path`; apply `overrides`, each "table.key=VALUE" with a TOML value (a bare word is taken
  /// as text).
  /// @throws InputError (exit code 4 if the file cannot be read, 2 if it does not parse or an override is
  /// malformed)
  static CaseFile read(const std::string& path, const std::vector<std::string>& overrides = {});
  /// The same from a text; `path` is only used in messages and to resolve relative files.
  static CaseFile parse(const std::string& text, const std::string& path,
                        const std::vector<std::string>& overrides = {});

  CaseTable table(std::string_view name, std::string_view meaning) const;
  std::vector<CaseTable> tables(std::string_view name, std::string_view meaning) const;
  bool has_table(std::string_view name) const;

  /// Entries of [[table]] by their key `name`, in the order of the file; {table} where the case has one
  /// [table], or one entry without a name. @throws InputError for an entry without a name among several, a
  /// name twice, one that is no word of letters, digits, '_' and '-' of at most 31 bytes, and names that are
  /// too long together for a HELLO
  std::vector<std::string> names_of(std::string_view table) const;
  /// Where the case has a list [[table]], go on with its entry `name` as if it were the only [table]. Empty:
  /// with the only entry. @returns the name. @throws InputError for an unknown name, or none among several
  std::string choose(std::string_view table, const std::string& name) const;

  /// Reject every key that nobody has read in the tables `read_here` (and their sub-tables), and every
  /// top-level table that is none of Undine's (run fluid solid coupling interface probe output checkpoint
  /// reference).
  void reject_unknown_keys(const std::vector<std::string>& read_here) const;

  /// Order-independent of nothing: FNV-1a of the text and the overrides, compared by the programs in their
  /// HELLO. Never 0.
  std::uint64_t hash() const;
  const std::string& path() const;
  /// `file` relative to the folder of the case, unless absolute.
  std::string resolve(const std::string& file) const;

  /// `text` with its place, source line and caret in front, if it begins with something that is written in
  /// the case: `table.key ...`, `table[2].key ...`, or `interface "name": key ...` (also probe), or the name
  /// of a file and a colon. Mistakes that show only when the mesh is there, such as a surface that does not
  /// exist, get their place so. Any other text comes back as it is.
  std::string with_place(const std::string& text) const;

  /// All keys described so far as rows of a Markdown table per case table (for docs/case-file.md).
  std::string documentation() const;

private:
  explicit CaseFile(std::shared_ptr<CaseDocument> document) : document_(std::move(document)) {}
  CaseTable root() const;
  std::shared_ptr<CaseDocument> document_;
};

} // namespace undine
