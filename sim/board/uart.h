// SPDX-License-Identifier: Apache-2.0
// The host's UART (8N1), bit by bit, at the other end of the board's two wires.
#pragma once

#include <cstdint>

class Uart {
 public:
  // Bits per clock = step / 2^16, as in rtl/link/lipp_uart_tx.sv.
  explicit Uart(uint32_t step) : step_(step) {}

  // Ready for the next byte.
  bool ready() const { return sending_ == 0; }
  void send(uint8_t byte) { sending_ = 0x600u | byte << 1 | 0u; left_ = 0x10000; }
  // Level of the wire to the board in the next clock.
  bool wire() {
    if (sending_ == 0) return true;
    const bool level = sending_ & 1;
    if (left_ <= step_) {
      left_ += 0x10000 - step_;
      sending_ >>= 1;
      if (sending_ == 1) sending_ = 0;  // the stop bit was the last
    } else {
      left_ -= step_;
    }
    return level;
  }

  // Samples the wire from the board, once a clock; returns the byte that it completes, or -1.
  int take(bool level) {
    if (taken_ == 0) {
      if (level) return -1;
      taken_ = 10;  // a start bit: half a bit to its middle
      wait_ = 0x8000;
    }
    if (wait_ > step_) {
      wait_ -= step_;
      return -1;
    }
    wait_ += 0x10000 - step_;
    word_ = static_cast<uint16_t>(word_ >> 1 | (level ? 0x200 : 0));
    if (--taken_ > 0) return -1;
    return (word_ & 0x200) != 0 && (word_ & 1) == 0 ? word_ >> 1 & 0xff : -1;
  }

 private:
  uint32_t step_;
  uint32_t sending_ = 0, left_ = 0;          // bits to send, lowest first, and a marker
  uint32_t wait_ = 0;
  uint16_t word_ = 0;
  int taken_ = 0;
};
