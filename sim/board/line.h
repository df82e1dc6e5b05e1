// SPDX-License-Identifier: Apache-2.0
// The host's end of the line: a pty or a TCP port on loopback, served by its own thread.
//
// The simulation uses two ring buffers and makes no system call; the thread sleeps in poll() until
// the host sends a byte or the simulation calls ring().
#pragma once

#include <atomic>
#include <string>
#include <thread>

#include "ring.h"

class Line {
 public:
  static constexpr size_t kPlaces = 1 << 14;

  // "pty" or "tcp"; port 0 chooses a free one. Throws std::system_error.
  Line(const std::string& kind, int port);
  ~Line();
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;

  // URL for pyserial: a device, or socket://127.0.0.1:PORT.
  const std::string& url() const { return url_; }
  Ring<kPlaces>& from_host() { return from_host_; }
  Ring<kPlaces>& to_host() { return to_host_; }
  // Wakes the thread: to_host() has bytes, or from_host() has room again.
  void ring();

 private:
  void serve();
  bool read_some();
  bool write_some();
  void hang_up();
  bool leaving() const;

  std::string url_;
  bool pty_;
  int listener_ = -1;  // TCP: waits for a host
  int far_end_ = -1;   // pty: kept open while hosts open and close it
  int host_ = -1;      // the host's bytes are read and written here
  int bell_[2] = {-1, -1};
  bool expects_ = false;  // the host has closed; the next one waits until its bytes are read
  std::atomic<bool> rung_{false};
  std::atomic<bool> stop_{false};
  Ring<kPlaces> from_host_, to_host_;
  std::thread thread_;
};
