// SPDX-License-Identifier: Apache-2.0
#include "screen.h"

#include <fcntl.h>

#include <cerrno>
#include <cstdio>
#include <system_error>
#include <utility>

Screen::Screen(int width, int height, std::string folder)
    : pixels_(size_t{3} * width * height), folder_(std::move(folder)) {}

bool Screen::finish() {
  const bool whole = at_ == pixels_.size();
  if (!whole && at_ != 0) ++broken_;
  at_ = 0;
  if (!whole) return false;
  ++frames_;
  if (!folder_.empty() && pixels_ != before_) {
    keep();
    before_ = pixels_;
  }
  return true;
}

void Screen::keep() const {
  char name[32];
  std::snprintf(name, sizeof name, "/frame-%08lld.rgb", static_cast<long long>(frames_));
  const std::string path = folder_ + name, part = path + ".part";
  // The removal and the flags O_EXCL and O_NOFOLLOW prevent a write through another user's link.
  std::remove(part.c_str());
  const int handle = open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
  std::FILE* file = handle < 0 ? nullptr : fdopen(handle, "wb");
  bool good = file != nullptr && std::fwrite(pixels_.data(), 1, pixels_.size(), file) == pixels_.size();
  int error = errno;
  if (file != nullptr && std::fclose(file) != 0) {
    if (good) error = errno;
    good = false;
  }
  if (good && std::rename(part.c_str(), path.c_str()) != 0) {
    error = errno;
    good = false;
  }
  if (good) return;
  std::remove(part.c_str());
  throw std::system_error(error, std::generic_category(), path);
}
