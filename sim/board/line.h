// The host's end of the line: a pty or a TCP port on loopback, served by a thread of its own.
//
// The simulation only touches two rings, so that it makes no system call; the thread sleeps in
// poll() until a byte comes from the host or the simulation has rung.
#pragma once

#include <atomic>
#include <string>
#include <thread>

#include "ring.h"

class Line {
 public:
  static constexpr size_t kPlaces = 1 << 16;

  // "pty" or "tcp"; port 0 takes any that is free. Throws std::system_error.
  Line(const std::string& kind, int port);
  ~Line();
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;

  // What pyserial opens: a device, or socket://127.0.0.1:PORT.
  const std::string& url() const { return url_; }
  Ring<kPlaces>& from_host() { return from_host_; }
  Ring<kPlaces>& to_host() { return to_host_; }
  // Wakes the thread: bytes are in to_host(), or from_host() has room again.
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
  int far_end_ = -1;   // pty: kept open, so that a host may come and go
  int host_ = -1;      // where bytes are read and written
  int bell_[2] = {-1, -1};
  bool expects_ = false;  // the host has closed its end, and another one waits for what it sent to be read
  std::atomic<bool> rung_{false};
  std::atomic<bool> stop_{false};
  Ring<kPlaces> from_host_, to_host_;
  std::thread thread_;
};
