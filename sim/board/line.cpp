// SPDX-License-Identifier: Apache-2.0
#include "line.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pty.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

namespace {

int checked(int result, const char* what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
  return result;
}

void never_wait(int file) {
  checked(fcntl(file, F_SETFL, checked(fcntl(file, F_GETFL), "fcntl") | O_NONBLOCK), "fcntl");
}

}  // namespace

Line::Line(const std::string& kind, int port) : pty_(kind == "pty") {
  checked(pipe(bell_), "pipe");
  never_wait(bell_[0]);
  never_wait(bell_[1]);
  if (pty_) {
    termios raw{};
    cfmakeraw(&raw);
    char name[256];
    checked(openpty(&host_, &far_end_, name, &raw, nullptr), "openpty");
    never_wait(host_);
    url_ = name;
  } else {
    listener_ = checked(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), "socket");
    const int yes = 1, buffer = 1 << 14;  // as small as a serial port's: a slow host is felt soon
    checked(setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes), "setsockopt");
    checked(setsockopt(listener_, SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer), "setsockopt");
    checked(setsockopt(listener_, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer), "setsockopt");
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    auto* place = reinterpret_cast<sockaddr*>(&address);
    socklen_t length = sizeof address;
    checked(bind(listener_, place, length), "bind");
    checked(listen(listener_, 1), "listen");
    checked(getsockname(listener_, place, &length), "getsockname");
    url_ = "socket://127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  }
  thread_ = std::thread(&Line::serve, this);
}

Line::~Line() {
  stop_ = true;
  rung_ = false;
  ring();
  thread_.join();
  for (int file : {listener_, far_end_, host_, bell_[0], bell_[1]})
    if (file >= 0) close(file);
}

void Line::ring() {
  if (!rung_.exchange(true)) {
    const char byte = 0;
    if (write(bell_[1], &byte, 1) < 0) return;  // the pipe is full: the thread is being woken
  }
}

void Line::serve() {
  while (!stop_) {
    pollfd wait[3] = {{bell_[0], POLLIN, 0}, {-1, 0, 0}, {-1, 0, 0}};
    if (host_ >= 0) {
      if (!expects_) wait[2] = {listener_, POLLIN, 0};
      wait[1].fd = host_;
      if (from_host_.room() != 0) wait[1].events |= POLLIN;
      if (to_host_.size() != 0) wait[1].events |= POLLOUT;
    } else {
      wait[1] = {listener_, POLLIN, 0};
    }
    // A pty that no host has open is never ready for writing: the timeout polls it again.
    if (poll(wait, 3, 1000) < 0 && errno != EINTR) return;
    if (wait[0].revents) {
      // Emptied before the flag is cleared: a later ring() writes to the pipe again.
      char bytes[64];
      while (read(bell_[0], bytes, sizeof bytes) > 0) continue;
      rung_ = false;
    }
    if (wait[2].revents && leaving()) {
      expects_ = true;
    } else if (wait[2].revents) {  // one host at a time: another one is disconnected at once
      const int other = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (other >= 0) close(other);
    }
    if (host_ < 0 && wait[1].revents) {
      host_ = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (host_ >= 0) {
        const int yes = 1;
        setsockopt(host_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        while (to_host_.size() != 0) to_host_.drop();  // replies to the host before
      }
    } else if (host_ >= 0 && wait[1].revents) {
      if ((wait[1].revents & (POLLIN | POLLHUP | POLLERR)) && !read_some()) hang_up();
      if (host_ >= 0 && (wait[1].revents & POLLOUT) && !write_some()) hang_up();
    }
  }
}

bool Line::read_some() {
  uint8_t bytes[4096];
  const size_t room = std::min(from_host_.room(), sizeof bytes);
  if (room == 0) return true;
  const ssize_t count = read(host_, bytes, room);
  if (count == 0) return pty_;
  if (count < 0) return errno == EAGAIN || errno == EINTR || (pty_ && errno == EIO);
  for (ssize_t k = 0; k < count; ++k) from_host_.put(bytes[k]);
  return true;
}

bool Line::write_some() {
  uint8_t bytes[4096];
  const size_t count = to_host_.copy(bytes, sizeof bytes);
  if (count == 0) return true;
  const ssize_t written = pty_ ? write(host_, bytes, count) : send(host_, bytes, count, MSG_NOSIGNAL);
  if (written < 0) return errno == EAGAIN || errno == EINTR || (pty_ && errno == EIO);
  for (ssize_t k = 0; k < written; ++k) to_host_.drop();
  return true;
}

void Line::hang_up() {
  if (pty_) return;
  close(host_);
  host_ = -1;
  expects_ = false;
}

bool Line::leaving() const {
  pollfd host{host_, POLLRDHUP, 0};
  return poll(&host, 1, 0) > 0;
}
