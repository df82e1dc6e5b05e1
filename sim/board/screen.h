// SPDX-License-Identifier: Apache-2.0
// The simulated panel: receives the pixels that the board scans out, and writes frames to files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

class Screen {
 public:
  // Writes each frame that differs from the previous frame to `folder` as frame-NUMBER.rgb (rows
  // from the top, bytes R, G, B). No file is ever partly written. If `folder` is empty, no file is
  // written. Throws std::system_error.
  Screen(int width, int height, std::string folder);

  // Samples the video in the first clock of a pixel; returns true at the end of a frame.
  bool clock(bool de, bool vsync, uint32_t rgb) {
    if (de) {
      if (at_ + 3 <= pixels_.size()) {
        pixels_[at_] = static_cast<uint8_t>(rgb >> 16);
        pixels_[at_ + 1] = static_cast<uint8_t>(rgb >> 8);
        pixels_[at_ + 2] = static_cast<uint8_t>(rgb);
      }
      at_ += 3;
    }
    const bool end = vsync && !vsync_;
    vsync_ = vsync;
    return end && finish();
  }
  int64_t frames() const { return frames_; }
  int64_t broken() const { return broken_; }  // number of frames with a wrong number of pixels

 private:
  bool finish();
  void keep() const;

  std::vector<uint8_t> pixels_, before_;
  std::string folder_;
  size_t at_ = 0;
  bool vsync_ = false;
  int64_t frames_ = 0, broken_ = 0;
};
