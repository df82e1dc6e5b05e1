// SPDX-License-Identifier: Apache-2.0
#include "host_socket.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pty.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

namespace {

int checked(int result, const char* what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
  return result;
}

void never_wait(int file) {
  checked(fcntl(file, F_SETFL, checked(fcntl(file, F_GETFL), "fcntl") | O_NONBLOCK), "fcntl");
}

// Hosts that wait while another one leaves.
constexpr int kBacklog = 16;
// Longest time to send the token, s.
constexpr int kTokenSeconds = 5;

// As small as a serial port's buffers: a slow host is felt soon.
void narrow(int socket) {
  const int buffer = 1 << 14;
  checked(setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer), "setsockopt");
  checked(setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer), "setsockopt");
}

std::string random_token() {
  unsigned char bytes[16];
  checked(getrandom(bytes, sizeof bytes, 0) == sizeof bytes ? 0 : -1, "getrandom");
  std::string token;
  for (const unsigned char byte : bytes) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02x", byte);
    token += digits;
  }
  return token;
}

// In a time that tells nothing of where they differ.
bool same(const std::string& one, const std::string& other) {
  unsigned char differ = one.size() != other.size();
  for (size_t k = 0; k < std::min(one.size(), other.size()); ++k)
    differ |= static_cast<unsigned char>(one[k] ^ other[k]);
  return differ == 0;
}

}  // namespace

HostSocket::HostSocket(const std::string& kind, int port, const std::string& place, int idle_s)
    : pty_(kind == "pty"), idle_s_(idle_s) {
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
  } else if (kind == "unix") {
    listen_at(place);
  } else {
    listen_on(port, place);
  }
  thread_ = std::thread(&HostSocket::serve, this);
}

void HostSocket::listen_at(const std::string& path) {
  listener_ = checked(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0), "socket");
  narrow(listener_);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path)
    throw std::system_error(ENAMETOOLONG, std::generic_category(), path);
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const mode_t before = umask(0177);
  const int bound = bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address);
  umask(before);
  checked(bound, "bind");
  file_ = path;
  checked(listen(listener_, kBacklog), "listen");
  url_ = "unix://" + path;
}

void HostSocket::listen_on(int port, const std::string& folder) {
  listener_ = checked(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), "socket");
  const int yes = 1;
  checked(setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes), "setsockopt");
  narrow(listener_);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* place = reinterpret_cast<sockaddr*>(&address);
  socklen_t length = sizeof address;
  checked(bind(listener_, place, length), "bind");
  checked(listen(listener_, kBacklog), "listen");
  checked(getsockname(listener_, place, &length), "getsockname");
  const std::string number = std::to_string(ntohs(address.sin_port));
  url_ = "socket://127.0.0.1:" + number;
  token_ = random_token() + "\n";
  const std::string path = folder + "/tcp-" + number + ".token";
  unlink(path.c_str());
  const int file = checked(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600), path.c_str());
  file_ = path;
  const bool written = write(file, token_.data(), token_.size()) == static_cast<ssize_t>(token_.size());
  if (close(file) != 0 || !written) throw std::system_error(errno, std::generic_category(), path);
}

HostSocket::~HostSocket() {
  stop_ = true;
  rung_ = false;
  ring();
  thread_.join();
  for (int file : {listener_, far_end_, host_, bell_[0], bell_[1]})
    if (file >= 0) close(file);
  if (!file_.empty()) unlink(file_.c_str());
}

void HostSocket::ring() {
  if (!rung_.exchange(true)) {
    const char byte = 0;
    if (write(bell_[1], &byte, 1) < 0) return;  // the pipe is full: the thread is being woken
  }
}

void HostSocket::serve() {
  while (!stop_) {
    pollfd wait[3] = {{bell_[0], POLLIN, 0}, {-1, 0, 0}, {-1, 0, 0}};
    if (host_ >= 0) {
      if (!expects_) wait[2] = {listener_, POLLIN, 0};
      wait[1].fd = host_;
      if (from_host_.room() != 0) wait[1].events |= POLLIN;
      if (to_host_.size() != 0 && let_in_) wait[1].events |= POLLOUT;
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
    if (host_ >= 0 && !let_in_ && silent_for(kTokenSeconds)) {
      hang_up();
      continue;
    }
    if (wait[2].revents && leaving()) {
      expects_ = true;
    } else if (wait[2].revents && silent_for(idle_s_)) {
      hang_up();
      continue;
    } else if (wait[2].revents) {  // one host at a time: another one is disconnected at once
      const int other = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (other >= 0) close(other);
    }
    if (host_ < 0 && wait[1].revents) {
      accept_host();
    } else if (host_ >= 0 && wait[1].revents) {
      if ((wait[1].revents & (POLLIN | POLLHUP | POLLERR)) && !read_some()) hang_up();
      if (host_ >= 0 && (wait[1].revents & POLLOUT) && !write_some()) hang_up();
    }
  }
}

void HostSocket::accept_host() {
  host_ = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (host_ < 0) return;
  const int yes = 1;
  setsockopt(host_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);  // a Unix socket has no such delay
  while (to_host_.size() != 0) to_host_.drop();                   // replies to the host before
  heard_ = Clock::now();
  told_.clear();
  let_in_ = token_.empty();
}

// Takes the next bytes of the token's line; a wrong one ends the connection. It is judged whole: a guess of its first
// letters is told nothing. Nothing of it reaches the board.
bool HostSocket::read_token() {
  char bytes[64];
  const ssize_t count = read(host_, bytes, std::min(sizeof bytes, token_.size() - told_.size()));
  if (count == 0) return false;
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  told_.append(bytes, static_cast<size_t>(count));
  if (told_.size() < token_.size() && told_.back() != '\n') return true;
  return let_in_ = same(told_, token_);
}

bool HostSocket::read_some() {
  if (!let_in_) return read_token();
  uint8_t bytes[4096];
  const size_t room = std::min(from_host_.room(), sizeof bytes);
  if (room == 0) return true;
  const ssize_t count = read(host_, bytes, room);
  if (count == 0) return pty_;
  if (count < 0) return errno == EAGAIN || errno == EINTR || (pty_ && errno == EIO);
  for (ssize_t k = 0; k < count; ++k) from_host_.put(bytes[k]);
  heard_ = Clock::now();
  return true;
}

bool HostSocket::write_some() {
  uint8_t bytes[4096];
  const size_t count = to_host_.copy(bytes, sizeof bytes);
  if (count == 0) return true;
  const ssize_t written = pty_ ? write(host_, bytes, count) : send(host_, bytes, count, MSG_NOSIGNAL);
  if (written < 0) return errno == EAGAIN || errno == EINTR || (pty_ && errno == EIO);
  for (ssize_t k = 0; k < written; ++k) to_host_.drop();
  heard_ = Clock::now();
  return true;
}

void HostSocket::hang_up() {
  if (pty_) return;
  close(host_);
  host_ = -1;
  expects_ = false;
}

bool HostSocket::leaving() const {
  pollfd host{host_, POLLRDHUP, 0};
  return poll(&host, 1, 0) > 0;
}
