// The word that somebody may have meant.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace undine
{

/// The entry of `known` with the smallest edit distance to `word`, or "" if none is near (distance > max(2,
/// length/3)).
std::string nearest_word(std::string_view word, const std::vector<std::string>& known);

} // namespace undine
