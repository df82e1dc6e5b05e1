// SPDX-License-Identifier: Apache-2.0
// Simulates a DVI receiver: samples the levels of the four pairs, and decodes the symbols.
//
// The receiver counts violations of DVI 1.0 and deviations from the panel's timing. The receiver is
// written from the standard, independently of rtl/video.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <string>

namespace dvi {

// Timing of a panel in pixels and lines. A line begins with hsync, a frame with vsync.
struct Timing {
  int width, height, h_front, h_sync, h_back, v_front, v_sync, v_back;
  bool h_positive, v_positive;
};

struct Pixel {
  bool de, hsync, vsync;  // hsync and vsync keep their values while de is true
  uint32_t rgb;
};

// Returns the symbol of a byte, computed by the flow chart of DVI 1.0. `count` is the number of
// ones minus the number of zeros since the last control symbol.
inline uint16_t encoded(unsigned byte, int count) {
  const int data_ones = __builtin_popcount(byte);
  const bool xnor = data_ones > 4 || (data_ones == 4 && (byte & 1) == 0);
  unsigned q = byte & 1;
  for (int k = 1; k < 8; ++k) q |= ((q >> (k - 1) ^ byte >> k ^ xnor) & 1) << k;
  const int ones = __builtin_popcount(q), zeros = 8 - ones;
  const bool even = count == 0 || ones == zeros;
  const bool invert = even ? xnor : (count > 0 && ones > zeros) || (count < 0 && zeros > ones);
  return static_cast<uint16_t>(invert << 9 | !xnor << 8 | (invert ? ~q & 0xff : q));
}

// Decodes the symbols of one channel, and counts the ones and zeros that were sent. At each
// difference of ones and zeros, only one symbol of a byte is legal: an inverted bit 8 gives
// more transitions, and an inverted bit 9 increases the difference between ones and zeros.
class Channel {
 public:
  Channel() {
    for (unsigned byte = 0; byte < 256; ++byte)
      for (int sign = -1; sign <= 1; ++sign) symbols_[sign + 1][byte] = encoded(byte, sign);
  }

  // Returns the byte, or 256 plus the two control bits.
  int decode(uint16_t symbol) {
    for (int c = 0; c < 4; ++c)
      if (symbol == kControl[c]) {
        count_ = 0;
        known_ = true;
        return 256 + c;
      }
    const unsigned q = (symbol >> 9 & 1 ? ~symbol : symbol) & 0xff;
    const unsigned changes = q ^ (q << 1 & 0xff);
    const unsigned byte = symbol >> 8 & 1 ? changes : changes ^ 0xfe;
    if (known_) {
      if (symbol != symbols_[(count_ > 0) - (count_ < 0) + 1][byte]) ++illegal_;
      count_ += 2 * __builtin_popcount(symbol) - 10;
      largest_ = std::max(largest_, std::abs(count_));
    }
    return static_cast<int>(byte);
  }
  void lose() { known_ = false; }  // the count is unknown until the next control symbol
  int64_t illegal() const { return illegal_; }
  int largest() const { return largest_; }

 private:
  static constexpr uint16_t kControl[4] = {0x354, 0x0ab, 0x154, 0x2ab};
  std::array<std::array<uint16_t, 256>, 3> symbols_{};
  bool known_ = false;
  int count_ = 0, largest_ = 0;
  int64_t illegal_ = 0;
};

// Tracks the position in the frame, counted from the start of a vertical sync.
class Raster {
 public:
  explicit Raster(const Timing& timing) : t_(timing) {}

  // Returns false if de or a sync of the pixel does not match the timing. After a mismatch, the
  // next vertical sync sets the position again.
  bool follow(const Pixel& pixel) {
    const bool hsync = pixel.hsync == t_.h_positive, vsync = pixel.vsync == t_.v_positive;
    const bool begins = before_ && !pixel.de && vsync;
    before_ = !pixel.de && !vsync;
    const int left = t_.h_sync + t_.h_back, top = t_.v_sync + t_.v_back;
    bool right = true;
    if (known_) {
      const bool de = x_ >= left && x_ < left + t_.width && y_ >= top && y_ < top + t_.height;
      right = pixel.de == de && (de || (hsync == (x_ < t_.h_sync) && vsync == (y_ < t_.v_sync)));
      known_ = right;
    }
    if (!known_ && begins) {
      known_ = true;
      x_ = y_ = 0;
    }
    if (known_ && ++x_ == left + t_.width + t_.h_front) {
      x_ = 0;
      if (++y_ == top + t_.height + t_.v_front) y_ = 0;
    }
    return right;
  }
  void lose() { known_ = before_ = false; }

 private:
  Timing t_;
  bool known_ = false, before_ = false;
  int x_ = 0, y_ = 0;
};

// Receives all channels. A symbol begins when the clock pair rises.
class Receiver {
 public:
  explicit Receiver(const Timing& timing) : raster_(timing) {}

  // Samples the levels of the four pairs, the clock in bit 3. Returns true if a pixel is complete.
  bool bit(uint8_t levels) {
    const bool begins = (levels & 8) != 0 && !clock_;
    clock_ = (levels & 8) != 0;
    bool whole = false;
    if (begins) {
      whole = known_ && places_ == 10;
      if (whole) decode();
      else lose();
      known_ = true;
      places_ = 0;
      symbols_ = {};
    }
    if (places_ < 10)
      for (int k = 0; k < 3; ++k) symbols_[k] |= (levels >> k & 1) << places_;
    ++places_;
    return whole;
  }
  const Pixel& pixel() const { return pixel_; }
  int64_t slips() const { return slips_; }

  // Returns members of a JSON object. The member symbol_slips counts symbols that were not ten bits
  // long. The member bad_symbols counts pixels for which some channels send data and others control
  // bits. The member illegal_symbols counts symbols that an encoder never sends at that point, and
  // unused control bits that are set. The member largest_disparity is the maximum difference
  // between ones and zeros since a control symbol. The member timing_breaks counts data and syncs
  // at a wrong position.
  std::string counts() const {
    int64_t illegal = controls_;
    int largest = 0;
    for (const Channel& channel : channels_) {
      illegal += channel.illegal();
      largest = std::max(largest, channel.largest());
    }
    return "\"symbol_slips\": " + std::to_string(slips_) + ", \"bad_symbols\": " + std::to_string(bad_) +
           ", \"illegal_symbols\": " + std::to_string(illegal) + ", \"largest_disparity\": " + std::to_string(largest) +
           ", \"timing_breaks\": " + std::to_string(breaks_);
  }

 private:
  void decode() {
    pixel_.rgb = 0;
    int data = 0;
    for (int k = 0; k < 3; ++k) {
      const int value = channels_[k].decode(symbols_[k]);
      if (value < 256) {
        ++data;
        pixel_.rgb |= static_cast<uint32_t>(value) << 8 * k;
      } else if (k == 0) {
        pixel_.hsync = value & 1;
        pixel_.vsync = value >> 1 & 1;
      } else if (value != 256) {
        ++controls_;  // CTL0 to CTL3 in channels 1 and 2 are not used by DVI
      }
    }
    pixel_.de = data == 3;
    if (data % 3 != 0) ++bad_;
    if (!raster_.follow(pixel_)) ++breaks_;
  }

  void lose() {
    if (known_) ++slips_;
    for (Channel& channel : channels_) channel.lose();
    raster_.lose();
  }

  std::array<Channel, 3> channels_;
  Raster raster_;
  std::array<uint16_t, 3> symbols_{};
  Pixel pixel_{};
  int places_ = 0;
  bool clock_ = true, known_ = false;
  int64_t slips_ = 0, bad_ = 0, controls_ = 0, breaks_ = 0;
};

}  // namespace dvi
