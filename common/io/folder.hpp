// Output folders and files that are replaced as a whole.
#pragma once

#include <string>

namespace undine
{

/// Create `path` and its parents. @throws Failure(output_failed) with path and reason
void make_folder(const std::string& path);

/// Replace the file `path` by `text`: written beside it, then renamed, so that a reader (or a kill) meets the
/// old content or the new one, never a part. @throws Failure(output_failed) with path and reason
/// `to_disk`: return only when the bytes are on the disk, so that a file written later proves this one.
void replace_file(const std::string& path, const std::string& text, bool to_disk = false);

} // namespace undine
