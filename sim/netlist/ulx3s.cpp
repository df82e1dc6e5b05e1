// SPDX-License-Identifier: Apache-2.0
// Simulates the ULX3S board: the netlist of rtl/board/ulx3s, or its RTL (ulx3s_pins.sv), together
// with models of the other chips on the board.
//
//   board --line unix|tcp|pty [--port N] [--place PATH] [--idle SECONDS] --ready FILE [--capture FOLDER] [--step N]
//
// The simulated parts are an oscillator, the outputs of the PLL, a UART, an SDRAM, and a screen
// that decodes the TMDS symbols of the GPDI socket. The options are those of sim/board/main.cpp.
// The option --step is 65536 times the UART's baud rate divided by the system clock frequency.
//
// The Python program tools.netlist builds this file and defines its macros. LIPPMANN_CLOCKS is a
// list of X(port, divider), one for each output of the PLL: pll_clkos is the clock of the TMDS bit
// pairs, pll_clkos2 the system clock, pll_clkos3 the memory clock. LIPPMANN_VCO_KHZ is the
// frequency of the VCO. LIPPMANN_TIMING lists the fields of dvi::Timing, except the panel's size.
//
// SIGTERM and SIGINT end the board. SIGUSR1 presses button 1 of the board. The last line on stdout
// is a JSON object of counts, which tools.netlist checks. The object also contains the name of each
// violation of the SDRAM's data sheet.
#include <getopt.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "Vtop.h"
#include "dvi.h"
#include "host_socket.h"
#include "screen.h"
#include "sdram.h"
#include "uart.h"
#include "verilated.h"

namespace {

std::atomic<bool> stop{false};
std::atomic<bool> reset{false};

struct Options {
  std::string line = "unix", place, ready, capture;
  int port = 0, idle = 60;
  uint32_t step = 0;
};

Options parse(int count, char** words) {
  const option known[] = {
      {"line", required_argument, nullptr, 'l'},    {"port", required_argument, nullptr, 'p'},
      {"ready", required_argument, nullptr, 'r'},   {"capture", required_argument, nullptr, 'c'},
      {"step", required_argument, nullptr, 's'},    {"identity", required_argument, nullptr, 'i'},
      {"place", required_argument, nullptr, 'a'},   {"idle", required_argument, nullptr, 'd'},
      {nullptr, 0, nullptr, 0}};
  Options options;
  for (int key; (key = getopt_long(count, words, "", known, nullptr)) != -1;) {
    switch (key) {
      case 'l': options.line = optarg; break;
      case 'p': options.port = std::stoi(optarg); break;
      case 'a': options.place = optarg; break;
      case 'd': options.idle = std::stoi(optarg); break;
      case 'r': options.ready = optarg; break;
      case 'c': options.capture = optarg; break;
      case 's': options.step = static_cast<uint32_t>(std::stoul(optarg)); break;
      case 'i': break;  // --identity is ignored: the netlist contains its identity
      default: throw std::invalid_argument("unknown option");
    }
  }
  if (options.step == 0 || options.step > 0x2000) throw std::invalid_argument("--step must be 1 to 8192");
  return options;
}

constexpr dvi::Timing kTiming{LIPPMANN_WIDTH, LIPPMANN_HEIGHT, LIPPMANN_TIMING};

class Board {
 public:
  explicit Board(const Options& options)
      : options_(options), line_(options.line, options.port, options.place, options.idle), uart_(options.step),
        screen_(LIPPMANN_WIDTH, LIPPMANN_HEIGHT, options.capture) {
    top_.ftdi_txd = 1;
    top_.eval();  // all clocks are low, so that the first evaluation has no edge
  }

  void run() {
    announce();
    const auto started = std::chrono::steady_clock::now();
    const std::clock_t used = std::clock();
    while (!stop.load(std::memory_order_relaxed)) {
      if (reset.exchange(false, std::memory_order_relaxed)) pressed_ = ticks_ + 10'000;
      for (int k = 0; k < 4096; ++k) edge();
    }
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    const double processor_seconds = static_cast<double>(std::clock() - used) / CLOCKS_PER_SEC;
    std::remove(options_.ready.c_str());
    top_.final();
    std::string violations;
    for (const auto& [name, times] : chip_.violations())
      violations += (violations.empty() ? "\"" : ", \"") + name + "\": " + std::to_string(times);
    std::printf("{\"clocks\": %lld, \"seconds\": %.3f, \"processor_seconds\": %.3f, \"bytes_in\": %lld, "
                "\"bytes_out\": %lld, \"frames\": %lld, \"broken_frames\": %lld, \"bytes_lost\": %lld, "
                "%s, \"sdram_reads\": %llu, \"sdram_writes\": %llu, "
                "\"sdram_violations\": {%s}, \"led\": %d}\n",
                static_cast<long long>(clocks_), seconds, processor_seconds, static_cast<long long>(in_),
                static_cast<long long>(out_), static_cast<long long>(screen_.frames()),
                static_cast<long long>(screen_.broken()), static_cast<long long>(lost_),
                receiver_.counts().c_str(),
                static_cast<unsigned long long>(chip_.reads()), static_cast<unsigned long long>(chip_.writes()),
                violations.c_str(), top_.led);
  }

 private:
  struct Clock {
    CData* pin;
    uint64_t half;  // half of the clock's period, in half periods of the VCO
    uint64_t next;
  };
  // time until the simulated PLL locks, in half periods of the VCO
  static constexpr uint64_t kLocked = 20'000;

  void announce() const {
    const std::string part = options_.ready + ".part";
    std::FILE* file = std::fopen(part.c_str(), "w");
    if (file == nullptr) throw std::system_error(errno, std::generic_category(), part);
    std::fprintf(file, "{\"url\": \"%s\", \"pid\": %d, \"width\": %d, \"height\": %d, \"line\": \"bits\"}\n",
                 line_.url().c_str(), static_cast<int>(getpid()), LIPPMANN_WIDTH, LIPPMANN_HEIGHT);
    if (std::fclose(file) != 0 || std::rename(part.c_str(), options_.ready.c_str()) != 0)
      throw std::system_error(errno, std::generic_category(), options_.ready);
  }

  // Advances to the next clock edge, and runs the edges of all clocks at that time.
  void edge() {
    uint64_t first = ~0ull;
    for (const Clock& clock : clocks_of_) first = std::min(first, clock.next);
    ticks_ = first;
    // the edge is slightly late, which is harmless: clk_25mhz only clocks the PLL's lock monitor
    if (ps() >= oscillator_ps_) {
      top_.clk_25mhz = !top_.clk_25mhz;
      oscillator_ps_ += 20'000;
    }
    const CData system = top_.pll_clkos2, memory = top_.pll_clkos3;
    const CData pairs = top_.pll_clkos;
    for (Clock& clock : clocks_of_)
      if (clock.next == ticks_) {
        *clock.pin = !*clock.pin;
        clock.next += clock.half;
      }
    top_.pll_lock = ticks_ > kLocked;
    top_.btn = ticks_ < pressed_;
    const bool system_rises = top_.pll_clkos2 && !system;
    if (system_rises) before_system();
    if (top_.pll_clkos3 && !memory) before_memory();
    top_.eval();
    if (system_rises) {
      const int byte = uart_.take(top_.ftdi_rxd);
      if (byte >= 0) send(static_cast<uint8_t>(byte));
    }
    if (!top_.pll_clkos3 && memory) chip_edge();
    if (top_.pll_clkos != pairs && receiver_.bit(top_.gpdi_dp)) {
      const auto& pixel = receiver_.pixel();
      const bool vsync = pixel.vsync == kTiming.v_positive;
      if (receiver_.slips() != slips_) steady_ = false;
      slips_ = receiver_.slips();
      steady_ = steady_ || (vsync && !vsync_);
      vsync_ = vsync;
      screen_.clock(pixel.de && steady_, vsync, pixel.rgb);
    }
  }

  uint64_t ps() const {
    return static_cast<uint64_t>(static_cast<unsigned __int128>(ticks_) * 500'000'000u / LIPPMANN_VCO_KHZ);
  }

  void before_system() {
    ++clocks_;
    if (ticks_ > 2 * kLocked && uart_.ready()) {
      const int byte = line_.from_host().peek();
      if (byte >= 0) {
        uart_.send(static_cast<uint8_t>(byte));
        line_.from_host().drop();
        ++in_;
        if (line_.from_host().room() == HostSocket::kPlaces / 2) line_.ring();
      }
    }
    top_.ftdi_txd = uart_.wire();
  }

  // Applies the word that the SDRAM drove in the clock before the SDRAM's last edge, because the word
  // needs that time to reach the FPGA (rtl/board/ulx3s/lipp_ulx3s_memory.sv). Bytes that the SDRAM
  // does not drive are random.
  void before_memory() {
    noise_ = noise_ * 1664525u + 1013904223u;
    const uint16_t driven = (on_way_ & 1 ? 0x00ff : 0) | (on_way_ & 2 ? 0xff00 : 0);
    top_.sdram_d = static_cast<SData>((word_ & driven) | (noise_ >> 16 & ~driven & 0xffff));
  }

  // Runs an edge of the SDRAM's clock, which is the inverted clock of the memory controller.
  void chip_edge() {
    if (!top_.sdram_clk) throw std::runtime_error("sdram_clk does not rise where its clock falls");
    word_ = chip_.dq();
    on_way_ = chip_.driving();
    if (ticks_ < kLocked / 2) return;
    SdramPins pins;
    pins.cke = top_.sdram_cke;
    pins.cs_n = top_.sdram_csn;
    pins.ras_n = top_.sdram_rasn;
    pins.cas_n = top_.sdram_casn;
    pins.we_n = top_.sdram_wen;
    pins.ba = top_.sdram_ba;
    pins.a = top_.sdram_a;
    pins.dqm = top_.sdram_dqm;
    pins.dq = top_.sdram_d__out;
    pins.oe = top_.sdram_d__en != 0;
    chip_.edge(ps(), pins);
  }

  void send(uint8_t byte) {
    ++out_;
    if (!line_.to_host().put(byte)) ++lost_;
    line_.ring();
  }

  const Options& options_;
  VerilatedContext context_;
  Vtop top_{&context_};
#define X(port, divider) {&top_.port, divider, divider},
  std::vector<Clock> clocks_of_{LIPPMANN_CLOCKS};
#undef X
  HostSocket line_;
  Uart uart_;
  Screen screen_;
  dvi::Receiver receiver_{kTiming};
  Sdram chip_{kGrade75};
  uint64_t ticks_ = 0, pressed_ = 0, oscillator_ps_ = 20'000;
  uint16_t word_ = 0;
  int on_way_ = 0;
  // A monitor that has lost the symbol boundaries shows nothing until the next vertical sync
  // begins. The FPGA's serialiser aligns itself with its first symbol after a reset.
  bool steady_ = false, vsync_ = false;
  int64_t slips_ = 0;
  uint32_t noise_ = 1;
  int64_t clocks_ = 0, in_ = 0, out_ = 0, lost_ = 0;
};

}  // namespace

int main(int count, char** words) {
  std::signal(SIGTERM, [](int) { stop = true; });
  std::signal(SIGINT, [](int) { stop = true; });
  std::signal(SIGUSR1, [](int) { reset = true; });
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
