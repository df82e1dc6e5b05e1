// SPDX-License-Identifier: Apache-2.0
// The virtual board: runs the RTL under Verilator, and connects its serial link to a Unix socket, a
// TCP port (loopback only) or a pty.
//
//   board --line unix|tcp|pty [--port N] [--place PATH] [--idle SECONDS] --identity HEX --ready FILE [--capture FOLDER]
//         [--step N] [--host-step N] [--stalls SEED] [--trace FILE --trace-from CLOCK --trace-to CLOCK]
//
// The option --place gives the path of the Unix socket, or for TCP the folder of the token's file.
// A host that is silent for --idle seconds can be replaced by another host.
//
// The Python module lippmann.simulation.virtual_board builds this program. With the parameter
// ByteLink = 1, bytes are transferred as fast as the board accepts them. With ByteLink = 0, the
// wires of a UART are simulated: --step is 65536 times the baud rate divided by the clock
// frequency. The option --host-step is the value of --step for the host's UART, by default --step.
// The option --stalls makes both ends of a byte link pause at random. The --ready file (JSON)
// contains the URL for the host, and exists while the board runs. If the macro LIPPMANN_MEMORY_HZ
// is defined, the frames are stored in an SDRAM that has its own clock.
//
// SIGTERM, SIGINT and SIGHUP end the board. SIGUSR1 resets the board. SIGUSR2 makes the SDRAM lose
// its contents. The last line on stdout is a JSON object of counts. The exit codes are those of
// `lippmann`.
#include <getopt.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>

#include "Vtop.h"
#include "Vtop___024root.h"
#include "host_socket.h"
#include "screen.h"
#include "sdram.h"
#include "uart.h"
#include "verilated.h"
#ifdef LIPPMANN_TRACE
#include "verilated_fst_c.h"
#endif

namespace {

std::atomic<bool> stop{false};
std::atomic<bool> reset{false};
std::atomic<bool> lose{false};

struct Options {
  std::string line = "unix", place, ready, capture, trace;
  int port = 0, idle = 60;
  uint32_t step = 0, host_step = 0, stalls = 0;
  uint64_t identity = 0;
  int64_t trace_from = 0, trace_to = INT64_MAX;
};

Options parse(int count, char** words) {
  const option known[] = {
      {"line", required_argument, nullptr, 'l'},       {"port", required_argument, nullptr, 'p'},
      {"identity", required_argument, nullptr, 'i'},   {"ready", required_argument, nullptr, 'r'},
      {"capture", required_argument, nullptr, 'c'},    {"step", required_argument, nullptr, 's'},
      {"place", required_argument, nullptr, 'a'},      {"idle", required_argument, nullptr, 'd'},
      {"host-step", required_argument, nullptr, 'h'},
      {"trace", required_argument, nullptr, 't'},      {"trace-from", required_argument, nullptr, 'f'},
      {"trace-to", required_argument, nullptr, 'e'},   {"stalls", required_argument, nullptr, 'x'},
      {nullptr, 0, nullptr, 0}};
  Options options;
  for (int key; (key = getopt_long(count, words, "", known, nullptr)) != -1;) {
    switch (key) {
      case 'l': options.line = optarg; break;
      case 'p': options.port = std::stoi(optarg); break;
      case 'a': options.place = optarg; break;
      case 'd': options.idle = std::stoi(optarg); break;
      case 'i': options.identity = std::stoull(optarg, nullptr, 16); break;
      case 'r': options.ready = optarg; break;
      case 'c': options.capture = optarg; break;
      case 's': options.step = static_cast<uint32_t>(std::stoul(optarg)); break;
      case 'h': options.host_step = static_cast<uint32_t>(std::stoul(optarg)); break;
      case 't': options.trace = optarg; break;
      case 'f': options.trace_from = std::stoll(optarg); break;
      case 'e': options.trace_to = std::stoll(optarg); break;
      case 'x': options.stalls = static_cast<uint32_t>(std::stoul(optarg)); break;
      default: throw std::invalid_argument("unknown option");
    }
  }
  if (options.host_step == 0) options.host_step = options.step;
  if (options.line != "unix" && options.line != "pty" && options.line != "tcp")
    throw std::invalid_argument("--line must be unix, tcp or pty");
  if (!LIPPMANN_BYTE_LINK && (options.step == 0 || options.step > 0x2000))
    throw std::invalid_argument("--step must be 1 to 8192, so that a bit takes 8 clocks or more");
#ifndef LIPPMANN_TRACE
  if (!options.trace.empty()) throw std::invalid_argument("--trace is not available: this board was built without waveforms");
#endif
  return options;
}

// Writes the file under another name and then renames the file, so that a waiting process never
// reads a part of the file.
void announce(const Options& options, const HostSocket& line) {
  const std::string part = options.ready + ".part";
  std::FILE* file = std::fopen(part.c_str(), "w");
  if (file == nullptr) throw std::system_error(errno, std::generic_category(), part);
  std::fprintf(file, "{\"url\": \"%s\", \"pid\": %d, \"width\": %d, \"height\": %d, \"line\": \"%s\"}\n",
               line.url().c_str(), static_cast<int>(getpid()), LIPPMANN_WIDTH, LIPPMANN_HEIGHT,
               LIPPMANN_BYTE_LINK ? "bytes" : "bits");
  if (std::fclose(file) != 0 || std::rename(part.c_str(), options.ready.c_str()) != 0)
    throw std::system_error(errno, std::generic_category(), options.ready);
}

// Models the frame memory outside the RTL. If LIPPMANN_MEMORY_HZ is defined, the memory is an SDRAM
// with its own clock; otherwise the class is empty, because the RTL contains the memory.
#ifdef LIPPMANN_MEMORY_HZ
class Memory {
 public:
  explicit Memory(Vtop& top) : top_(top) {}

  // Runs the edges of the memory's clock that are due before the next edge of the board's clock.
  void clock() {
    for (due_ += LIPPMANN_MEMORY_HZ; due_ >= LIPPMANN_CLOCK_HZ; due_ -= LIPPMANN_CLOCK_HZ) edge();
  }
  void lose() { chip_.lose(); }
  int64_t violations() const {
    int64_t sum = 0;
    for (const auto& [name, count] : chip_.violations()) sum += static_cast<int64_t>(count);
    return sum;
  }

 private:
  // The SDRAM samples the pins as they were before the edge. Undriven data bits are random.
  void edge() {
    SdramPins pins;
    pins.cke = top_.cke_o;
    pins.cs_n = top_.cs_no;
    pins.ras_n = top_.ras_no;
    pins.cas_n = top_.cas_no;
    pins.we_n = top_.we_no;
    pins.ba = top_.ba_o;
    pins.a = top_.a_o;
    pins.dqm = top_.dqm_o;
    pins.dq = top_.dq_o;
    pins.oe = top_.dq_oe_o;
    const int driven = chip_.driving();
    const uint16_t lanes = static_cast<uint16_t>((driven & 1 ? 0xff : 0) | (driven & 2 ? 0xff00 : 0));
    top_.dq_i = static_cast<uint16_t>((chip_.dq() & lanes) | (static_cast<uint32_t>(edges_) * 40503u & ~lanes));
    top_.mem_clk_i = 1;
    top_.eval();
    // Before the first clock edges the pin values are not valid.
    if (++edges_ > 3) chip_.edge(static_cast<uint64_t>(edges_) * (1'000'000'000'000 / LIPPMANN_MEMORY_HZ), pins);
    top_.mem_clk_i = 0;
    top_.rootp->__Vtrigprevexpr___TOP__mem_clk_i__0 = 0;
  }

  Vtop& top_;
  Sdram chip_{kGrade75};
  int64_t due_ = 0, edges_ = 0;
};
#else
class Memory {
 public:
  explicit Memory(Vtop&) {}
  void clock() {}
  void lose() {}
  int64_t violations() const { return 0; }
};
#endif

class Board {
 public:
  explicit Board(const Options& options) : options_(options), line_(options.line, options.port, options.place, options.idle), uart_(options.host_step),
      screen_(LIPPMANN_WIDTH, LIPPMANN_HEIGHT, options.capture) {
    top_.identity_i = options.identity;
    top_.step_i = static_cast<uint16_t>(options.step);
    top_.rx_i = 1;
    top_.in_valid_i = 0;
    top_.out_ready_i = 0;
#ifdef LIPPMANN_TRACE
    if (!options.trace.empty()) {
      context_.traceEverOn(true);
      top_.trace(&trace_, 99);
      trace_.open(options.trace.c_str());
    }
#endif
    restart();
  }

  void run() {
    if (!options_.ready.empty()) announce(options_, line_);
    const auto started = std::chrono::steady_clock::now();
    const std::clock_t used = std::clock();
    while (!stop.load(std::memory_order_relaxed)) {
      if (reset.exchange(false, std::memory_order_relaxed)) restart();
      if (lose.exchange(false, std::memory_order_relaxed)) memory_.lose();
      const bool waits = idle();
      if (waits) std::this_thread::sleep_for(std::chrono::milliseconds(10));
      for (int k = 0; k < (waits ? 64 : 1024); ++k) step();
    }
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    const double processor_seconds = static_cast<double>(std::clock() - used) / CLOCKS_PER_SEC;
    if (!options_.ready.empty()) std::remove(options_.ready.c_str());
    top_.final();
    std::printf("{\"clocks\": %lld, \"seconds\": %.3f, \"processor_seconds\": %.3f, \"bytes_in\": %lld, "
                "\"bytes_out\": %lld, \"frames\": %lld, \"broken_frames\": %lld, \"bytes_lost\": %lld, \"memory_violations\": %lld}\n",
                static_cast<long long>(clocks_), seconds, processor_seconds, static_cast<long long>(in_),
                static_cast<long long>(out_), static_cast<long long>(screen_.frames()),
                static_cast<long long>(screen_.broken()), static_cast<long long>(lost_),
                static_cast<long long>(memory_.violations()));
  }

 private:
  // Returns true if the board is idle: the last request was answered so long ago that the panel
  // shows its result, and no waveform is requested. To save processor time, an idle board runs its
  // clock at a small fraction of its speed until the host's next byte.
  bool idle() const {
    return answered_ && options_.trace.empty() &&
           clocks_ - spoke_ > 1'000'000 + 4LL * LIPPMANN_WIDTH * LIPPMANN_HEIGHT;
  }

  void restart() {
    spoke_ = clocks_;
    top_.rst_ni = 1;
    clock();
    top_.rst_ni = 0;
    clock();
    clock();
    top_.rst_ni = 1;
  }

  // Runs one rising edge of the clock. The model is not evaluated at the falling edge, at which
  // nothing happens.
  void clock() {
    top_.clk_i = 1;
    top_.eval();
    dump();
    top_.clk_i = 0;
    top_.rootp->__Vtrigprevexpr___TOP__clk_i__0 = 0;
    ++clocks_;
    memory_.clock();
  }

  void dump() {
#ifdef LIPPMANN_TRACE
    if (trace_.isOpen() && clocks_ >= options_.trace_from && clocks_ < options_.trace_to)
      trace_.dump(static_cast<uint64_t>(clocks_));
#endif
  }

  void step() {
    if (LIPPMANN_BYTE_LINK) {
      const int byte = paused() && !offered_ ? -1 : line_.from_host().peek();
      top_.in_valid_i = byte >= 0;
      if (byte >= 0) top_.in_data_i = static_cast<uint8_t>(byte);
      top_.out_ready_i = line_.to_host().room() != 0 && !paused();
      // The handshakes of a clock are known before its edge, because they depend only on registers.
      const bool took = byte >= 0 && top_.in_ready_o;
      offered_ = byte >= 0 && !took;
      if (top_.out_valid_o && top_.out_ready_i) send(top_.out_data_o);
      clock();
      if (took) taken();
    } else {
      if (uart_.ready()) {
        const int byte = line_.from_host().peek();
        if (byte >= 0) {
          uart_.send(static_cast<uint8_t>(byte));
          taken();
        }
      }
      top_.rx_i = uart_.wire();
      clock();
      const int byte = uart_.take(top_.tx_o);
      if (byte >= 0) send(static_cast<uint8_t>(byte));
    }
    if (top_.pixel_o) screen_.clock(top_.de_o, top_.vsync_o == LIPPMANN_VSYNC, top_.rgb_o);
  }

  // Returns true if one end of the byte link pauses in this clock. Phases of about 2000 clocks
  // alternate: in one, each end pauses at random in three of four clocks; in the other, none pauses.
  bool paused() {
    if (options_.stalls == 0) return false;
    random_ ^= random_ << 13;
    random_ ^= random_ >> 17;
    random_ ^= random_ << 5;
    if ((random_ & 0xfff) == 0) calm_ = !calm_;
    return !calm_ && (random_ >> 12 & 3) != 0;
  }

  void taken() {
    line_.from_host().drop();
    ++in_;
    spoke_ = clocks_;
    answered_ = false;
    // The socket's thread stops at a full buffer; ring() wakes it when half the buffer is free.
    if (line_.from_host().room() == HostSocket::kPlaces / 2) line_.ring();
  }

  void send(uint8_t byte) {
    ++out_;
    spoke_ = clocks_;
    answered_ = true;
    if (!line_.to_host().put(byte)) ++lost_;
    line_.ring();
  }

  const Options& options_;
  VerilatedContext context_;
  Vtop top_{&context_};
#ifdef LIPPMANN_TRACE
  VerilatedFstC trace_;
#endif
  Memory memory_{top_};
  HostSocket line_;
  Uart uart_;
  Screen screen_;
  int64_t clocks_ = 0, in_ = 0, out_ = 0, lost_ = 0;
  uint32_t random_ = options_.stalls;
  bool calm_ = false, offered_ = false;
  int64_t spoke_ = 0;     // clock of the last byte from or to the host
  bool answered_ = true;  // true: the board sent the last byte
};

}  // namespace

int main(int count, char** words) {
  std::signal(SIGTERM, [](int) { stop = true; });
  std::signal(SIGINT, [](int) { stop = true; });
  std::signal(SIGHUP, [](int) { stop = true; });
  std::signal(SIGUSR1, [](int) { reset = true; });
  std::signal(SIGUSR2, [](int) { lose = true; });
  std::signal(SIGPIPE, SIG_IGN);
  prctl(PR_SET_PDEATHSIG, SIGTERM);  // ends this process when its parent ends
  std::string ready;
  try {
    const Options options = parse(count, words);
    ready = options.ready;
    auto board = std::make_unique<Board>(options);
    board->run();
    return 0;
  } catch (const std::system_error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    if (!ready.empty()) std::remove(ready.c_str());
    return 3;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
