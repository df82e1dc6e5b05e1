// SPDX-License-Identifier: Apache-2.0
// The host's socket: a Unix socket, a TCP port on loopback, or a pty, served by its own thread.
//
// One host at a time. A second one is disconnected at once, unless the first has been silent for a while. Only this
// user's programs get in: the Unix socket has mode 0600; over TCP a host first sends a line with the token that is in a
// file of mode 0600.
//
// The simulation uses two ring buffers and makes no system call; the thread sleeps in poll() until
// the host sends a byte or the simulation calls ring().
#pragma once

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "ring.h"

class HostSocket {
 public:
  static constexpr size_t kPlaces = 1 << 14;

  // "unix": a socket at the path `place`. "tcp": port 0 chooses a free one; the token is in `place`/tcp-PORT.token.
  // "pty". A host that is silent for `idle_s` makes room for another one. Throws std::system_error.
  HostSocket(const std::string& kind, int port, const std::string& place, int idle_s);
  ~HostSocket();
  HostSocket(const HostSocket&) = delete;
  HostSocket& operator=(const HostSocket&) = delete;

  // URL for the host: a device, unix://PATH, or socket://127.0.0.1:PORT.
  const std::string& url() const { return url_; }
  Ring<kPlaces>& from_host() { return from_host_; }
  Ring<kPlaces>& to_host() { return to_host_; }
  // Wakes the thread: to_host() has bytes, or from_host() has room again.
  void ring();

 private:
  using Clock = std::chrono::steady_clock;

  void listen_at(const std::string& path);
  void listen_on(int port, const std::string& folder);
  void accept_host();
  bool read_token();
  void serve();
  bool read_some();
  bool write_some();
  void hang_up();
  bool leaving() const;
  bool silent_for(int seconds) const { return Clock::now() - heard_ > std::chrono::seconds(seconds); }

  std::string url_, file_;  // file_: the socket, or the token's; removed at the end
  std::string token_;       // with its line's end; empty: none is asked for
  std::string told_;        // what the host has sent of it
  bool let_in_ = true;      // the host has sent the token, or none is asked for
  int idle_s_;
  Clock::time_point heard_;  // the host's last byte, either way
  bool pty_;
  int listener_ = -1;  // a socket: waits for a host
  int far_end_ = -1;   // pty: kept open while hosts open and close it
  int host_ = -1;      // the host's bytes are read and written here
  int bell_[2] = {-1, -1};
  bool expects_ = false;  // the host has closed; the next one waits until its bytes are read
  std::atomic<bool> rung_{false};
  std::atomic<bool> stop_{false};
  Ring<kPlaces> from_host_, to_host_;
  std::thread thread_;
};
