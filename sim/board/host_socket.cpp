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

int check_result(int result, const char* what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
  return result;
}

void set_nonblocking(int file) {
  check_result(fcntl(file, F_SETFL, check_result(fcntl(file, F_GETFL), "fcntl") | O_NONBLOCK), "fcntl");
}

// Maximum number of hosts that wait for the connected host to leave (backlog of listen()).
constexpr int kBacklog = 16;
// Maximum time in seconds from the connection of a host until it has sent the token.
constexpr int kTokenSeconds = 5;

// Limits the socket buffers to a serial port's size, so that a slow host soon stalls the board.
void limit_buffers(int socket) {
  const int buffer = 1 << 14;
  check_result(setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer), "setsockopt");
  check_result(setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer), "setsockopt");
}

std::string random_token() {
  unsigned char bytes[16];
  check_result(getrandom(bytes, sizeof bytes, 0) == sizeof bytes ? 0 : -1, "getrandom");
  std::string token;
  for (const unsigned char byte : bytes) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02x", byte);
    token += digits;
  }
  return token;
}

// Compares two strings in a time that does not depend on the position of their first difference.
bool equal_strings(const std::string& one, const std::string& other) {
  unsigned char differ = one.size() != other.size();
  for (size_t k = 0; k < std::min(one.size(), other.size()); ++k)
    differ |= static_cast<unsigned char>(one[k] ^ other[k]);
  return differ == 0;
}

}  // namespace

HostSocket::HostSocket(const std::string& kind, int port, const std::string& place, int idle_s)
    : pty_(kind == "pty"), idle_s_(idle_s) {
  check_result(pipe(bell_), "pipe");
  set_nonblocking(bell_[0]);
  set_nonblocking(bell_[1]);
  if (pty_) {
    termios raw{};
    cfmakeraw(&raw);
    char name[256];
    check_result(openpty(&host_, &far_end_, name, &raw, nullptr), "openpty");
    set_nonblocking(host_);
    url_ = name;
  } else if (kind == "unix") {
    listen_at(place);
  } else {
    listen_on(port, place);
  }
  thread_ = std::thread(&HostSocket::serve, this);
}

void HostSocket::listen_at(const std::string& path) {
  listener_ = check_result(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0), "socket");
  limit_buffers(listener_);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path)
    throw std::system_error(ENAMETOOLONG, std::generic_category(), path);
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const mode_t before = umask(0177);
  const int bound = bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address);
  umask(before);
  check_result(bound, "bind");
  file_ = path;
  check_result(listen(listener_, kBacklog), "listen");
  url_ = "unix://" + path;
}

void HostSocket::listen_on(int port, const std::string& folder) {
  listener_ = check_result(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), "socket");
  const int yes = 1;
  check_result(setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes), "setsockopt");
  limit_buffers(listener_);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* place = reinterpret_cast<sockaddr*>(&address);
  socklen_t length = sizeof address;
  check_result(bind(listener_, place, length), "bind");
  check_result(listen(listener_, kBacklog), "listen");
  check_result(getsockname(listener_, place, &length), "getsockname");
  const std::string number = std::to_string(ntohs(address.sin_port));
  url_ = "socket://127.0.0.1:" + number;
  token_ = random_token() + "\n";
  const std::string path = folder + "/tcp-" + number + ".token";
  unlink(path.c_str());
  const int file = check_result(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600), path.c_str());
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
    // if the pipe is full, the thread is already being woken
    if (write(bell_[1], &byte, 1) < 0) return;
  }
}

void HostSocket::serve() {
  while (!stop_) {
    pollfd wait[3] = {{bell_[0], POLLIN, 0}, {-1, 0, 0}, {-1, 0, 0}};
    if (host_ >= 0) {
      if (!next_host_waits_) wait[2] = {listener_, POLLIN, 0};
      wait[1].fd = host_;
      if (from_host_.room() != 0) wait[1].events |= POLLIN;
      if (to_host_.size() != 0 && authorised_) wait[1].events |= POLLOUT;
    } else {
      wait[1] = {listener_, POLLIN, 0};
    }
    // A pty that no host has opened never reports POLLOUT. After a timeout, poll() is called again.
    if (poll(wait, 3, 1000) < 0 && errno != EINTR) return;
    if (wait[0].revents) {
      // The pipe is emptied before the flag is cleared, so a later ring() writes to the pipe again.
      char bytes[64];
      while (read(bell_[0], bytes, sizeof bytes) > 0) continue;
      rung_ = false;
    }
    if (host_ >= 0 && !authorised_ && silent_for(kTokenSeconds)) {
      disconnect_host();
      continue;
    }
    if (wait[2].revents && leaving()) {
      next_host_waits_ = true;
    } else if (wait[2].revents && silent_for(idle_s_)) {
      disconnect_host();
      continue;
    } else if (wait[2].revents) {  // one host at a time: disconnect others
      const int other = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (other >= 0) close(other);
    }
    if (host_ < 0 && wait[1].revents) {
      accept_host();
    } else if (host_ >= 0 && wait[1].revents) {
      if ((wait[1].revents & (POLLIN | POLLHUP | POLLERR)) && !read_some()) disconnect_host();
      if (host_ >= 0 && (wait[1].revents & POLLOUT) && !write_some()) disconnect_host();
    }
  }
}

void HostSocket::accept_host() {
  host_ = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (host_ < 0) return;
  const int yes = 1;
  setsockopt(host_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);  // no effect on a Unix socket
  while (to_host_.size() != 0) to_host_.drop();  // drop replies to the previous host
  last_byte_time_ = Clock::now();
  received_token_.clear();
  authorised_ = token_.empty();
}

// Reads the next bytes of the token. A wrong token ends the connection. The token is compared only
// after all its bytes have arrived, so that a wrong guess does not reveal how many letters are
// correct. No byte of the token reaches the board.
bool HostSocket::read_token() {
  char bytes[64];
  const ssize_t count = read(host_, bytes, std::min(sizeof bytes, token_.size() - received_token_.size()));
  if (count == 0) return false;
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  received_token_.append(bytes, static_cast<size_t>(count));
  if (received_token_.size() < token_.size() && received_token_.back() != '\n') return true;
  return authorised_ = equal_strings(received_token_, token_);
}

bool HostSocket::read_some() {
  if (!authorised_) return read_token();
  uint8_t bytes[4096];
  const size_t room = std::min(from_host_.room(), sizeof bytes);
  if (room == 0) return true;
  const ssize_t count = read(host_, bytes, room);
  if (count == 0) return pty_;
  if (count < 0) return errno == EAGAIN || errno == EINTR || (pty_ && errno == EIO);
  for (ssize_t k = 0; k < count; ++k) from_host_.put(bytes[k]);
  last_byte_time_ = Clock::now();
  return true;
}

bool HostSocket::write_some() {
  uint8_t bytes[4096];
  const size_t count = to_host_.copy(bytes, sizeof bytes);
  if (count == 0) return true;
  const ssize_t written = pty_ ? write(host_, bytes, count) : send(host_, bytes, count, MSG_NOSIGNAL);
  if (written < 0) return errno == EAGAIN || errno == EINTR || (pty_ && errno == EIO);
  for (ssize_t k = 0; k < written; ++k) to_host_.drop();
  last_byte_time_ = Clock::now();
  return true;
}

void HostSocket::disconnect_host() {
  if (pty_) return;
  close(host_);
  host_ = -1;
  next_host_waits_ = false;
}

bool HostSocket::leaving() const {
  pollfd host{host_, POLLRDHUP, 0};
  return poll(&host, 1, 0) > 0;
}
