// SPDX-License-Identifier: Apache-2.0
// Connects the host to the simulated board through a Unix socket, TCP on loopback, or a pty.
//
// The connection has its own thread and serves one host at a time. A second host is disconnected at
// once, unless the first host has been silent for `idle_s` seconds. Only programs of the same user
// can connect: the Unix socket has mode 0600. Over TCP a host must first send a line with a token,
// which only the board's user can read from a file of mode 0600.
//
// The simulation exchanges bytes with the thread through two ring buffers, without a system call.
// The thread sleeps in poll() until the host sends a byte or the simulation calls ring().
#pragma once

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "ring.h"

class HostSocket {
 public:
  static constexpr size_t kPlaces = 1 << 14;

  // Opens a connection of `kind` "unix", "tcp" or "pty". For "unix", `place` is the path of the
  // socket. For "tcp", port 0 selects a free port, and the token is written into the file
  // `place`/tcp-PORT.token. A host that is silent for `idle_s` seconds can be replaced by another
  // host. Throws std::system_error.
  HostSocket(const std::string& kind, int port, const std::string& place, int idle_s);
  ~HostSocket();
  HostSocket(const HostSocket&) = delete;
  HostSocket& operator=(const HostSocket&) = delete;

  // Returns the host's URL: the path of the pty, unix://PATH, or socket://127.0.0.1:PORT.
  const std::string& url() const { return url_; }
  Ring<kPlaces>& from_host() { return from_host_; }
  Ring<kPlaces>& to_host() { return to_host_; }
  // Wakes the thread; to be called when to_host() has bytes or from_host() has room again.
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
  void disconnect_host();
  bool leaving() const;
  bool silent_for(int seconds) const { return Clock::now() - last_byte_time_ > std::chrono::seconds(seconds); }

  // file_: path of the Unix socket or of the token's file; the destructor deletes the file
  std::string url_, file_;
  std::string token_;           // the token and its newline; empty if no token is required
  std::string received_token_;  // token bytes received from the host so far
  bool authorised_ = true;      // true: the host has sent the token, or no token is required
  int idle_s_;
  Clock::time_point last_byte_time_;  // time of the last byte to or from the host
  bool pty_;
  int listener_ = -1;  // listening socket, -1 for a pty
  int far_end_ = -1;   // the host's end of the pty, kept open while hosts change
  int host_ = -1;      // file descriptor of the host's connection
  int bell_[2] = {-1, -1};
  bool next_host_waits_ = false;  // the next host waits until the old host's bytes are read
  std::atomic<bool> rung_{false};
  std::atomic<bool> stop_{false};
  Ring<kPlaces> from_host_, to_host_;
  std::thread thread_;
};
