// SPDX-License-Identifier: Apache-2.0
// Simulates the host's UART (8 data bits, no parity, 1 stop bit) at the board's two wires.
#pragma once

#include <cstdint>

class Uart {
 public:
  // The baud rate is step / 2^16 bits per board clock, as in rtl/link/lipp_uart_tx.sv.
  explicit Uart(uint32_t step) : step_(step) {}

  // Returns true if the next byte can be sent.
  bool ready() const { return sending_ == 0; }
  void send(uint8_t byte) { sending_ = 0x600u | byte << 1 | 0u; left_ = 0x10000; }
  // Returns the level of the wire to the board in the next clock.
  bool wire() {
    if (sending_ == 0) return true;
    const bool level = sending_ & 1;
    if (left_ <= step_) {
      left_ += 0x10000 - step_;
      sending_ >>= 1;
      if (sending_ == 1) sending_ = 0;  // only the marker is left: all bits are sent
    } else {
      left_ -= step_;
    }
    return level;
  }

  // Samples the wire from the board once per clock; returns a byte when it is complete, else -1.
  int take(bool level) {
    if (taken_ == 0) {
      if (level) return -1;
      taken_ = 10;  // start bit: wait half a bit time, to its middle
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
  uint32_t sending_ = 0, left_ = 0;  // sending_: bits to send, lowest first, then a marker bit
  uint32_t wait_ = 0;
  uint16_t word_ = 0;
  int taken_ = 0;
};
