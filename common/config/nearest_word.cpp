// Edit distance (Levenshtein) of words.
#include "common/config/nearest_word.hpp"

#include <algorithm>

namespace undine
{
namespace
{

std::size_t edit_distance(std::string_view a, std::string_view b)
{
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j)
    row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i)
  {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j)
    {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row[b.size()];
}

} // namespace

std::string nearest_word(std::string_view word, const std::vector<std::string>& known)
{
  const std::size_t limit = std::max<std::size_t>(2, word.size() / 3);
  std::string nearest;
  std::size_t smallest = limit + 1;
  for (const std::string& candidate : known)
    // A distance as long as the word itself would call any short word near.
    if (const std::size_t distance = edit_distance(word, candidate);
        distance < smallest && distance < std::max(word.size(), candidate.size()))
    {
      smallest = distance;
      nearest = candidate;
    }
  return nearest;
}

} // namespace undine
