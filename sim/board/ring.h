// SPDX-License-Identifier: Apache-2.0
// Ring buffer that passes bytes from one thread to another, without locks or system calls.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

template <size_t Places>  // Places: capacity in bytes, a power of two
class Ring {
 public:
  bool put(uint8_t byte) {
    const size_t at = written_.load(std::memory_order_relaxed);
    if (at - read_.load(std::memory_order_acquire) == Places) return false;
    bytes_[at % Places] = byte;
    written_.store(at + 1, std::memory_order_release);
    return true;
  }
  // Returns the oldest byte without removing it, or -1 if the buffer is empty.
  int peek() const {
    const size_t at = read_.load(std::memory_order_relaxed);
    return written_.load(std::memory_order_acquire) == at ? -1 : bytes_[at % Places];
  }
  // Copies up to `most` of the oldest bytes without removing them, and returns their number.
  size_t copy(uint8_t* to, size_t most) const {
    const size_t at = read_.load(std::memory_order_relaxed);
    const size_t count = std::min(most, written_.load(std::memory_order_acquire) - at);
    for (size_t k = 0; k < count; ++k) to[k] = bytes_[(at + k) % Places];
    return count;
  }
  void drop() { read_.store(read_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }
  size_t room() const {
    return Places - (written_.load(std::memory_order_acquire) - read_.load(std::memory_order_acquire));
  }
  size_t size() const { return Places - room(); }

 private:
  std::array<uint8_t, Places> bytes_{};
  alignas(64) std::atomic<size_t> written_{0};
  alignas(64) std::atomic<size_t> read_{0};
};
