// The top of an FPGA board with a chip of SDRAM and a host at its wires; writes the last whole frame of its video.
//
//   top KEY=VALUE ...   in: bytes that the host sends; out: bytes of the board; video: red, green, blue of each pixel
//
// A turn is an edge of the PLL's VCO, of vco_ps / 2. The chip is pad_ps of delay away, there and back
// together. The host's list is a file of (replies, length, bytes): so many replies, which end with a
// zero byte, are heard before these bytes are sent.
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "Vtop.h"
#include "Vtop___024root.h"
#include "../../../sim/board/sdram.h"
#include "../../../sim/board/uart.h"
#include "../../../sim/netlist/dvi.h"
#include "verilated.h"

int main(int argc, char** argv) {
  auto context = std::make_unique<VerilatedContext>();
  context->commandArgs(argc, argv);
  std::map<std::string, std::string> given;
  for (int k = 1; k < argc; ++k) {
    const std::string text = argv[k];
    const size_t equals = text.find('=');
    if (equals != std::string::npos && text[0] != '+') given[text.substr(0, equals)] = text.substr(equals + 1);
  }
  auto number = [&](const char* name) { return std::strtoull(given.at(name).c_str(), nullptr, 10); };
  const uint64_t half_ps = number("vco_ps") / 2, pad_ps = number("pad_ps");
  const uint64_t system_div = number("system_div"), shift_div = number("shift_div");
  const uint64_t frame_turns = number("frame_turns"), most_turns = number("most_turns");

  std::ifstream file(given.at("in"), std::ios::binary);
  std::vector<uint8_t> in{std::istreambuf_iterator<char>(file), {}};
  std::ofstream out(given.at("out"), std::ios::binary), video(given.at("video"), std::ios::binary);
  size_t at = 0;
  uint64_t heard = 0;
  std::deque<uint8_t> sending;

  auto top = std::make_unique<Vtop>(context.get());
  auto* lock = &top->rootp->lipp_ulx3s__DOT__i_clocks__DOT__i_pll__DOT__lock;
  Sdram chip(kGrade75);
  Uart uart(static_cast<uint32_t>(number("step")));
  struct Later {
    uint64_t when;
    SdramPins pins;
    bool clock;
  };
  std::deque<Later> to_chip;
  std::deque<std::pair<uint64_t, uint16_t>> to_board;
  bool chip_clock = false;
  uint16_t dq = 0xffff;
  auto size = [&](const char* name) { return static_cast<int>(number(name)); };
  dvi::Receiver receiver({size("width"), size("height"), size("h_front"), size("h_sync"), size("h_back"),
                          size("v_front"), size("v_sync"), size("v_back"), false, false});
  std::vector<char> frame, last_frame;
  bool in_sync = false;
  uint64_t end = ~0ull, turn = 0, unlock_at = ~0ull;
  top->btn = 0;
  top->ftdi_txd = 1;
  *lock = 0;
  for (int level : {1, 0, 1}) {
    top->clk_25mhz = level;
    top->eval();
  }
  for (; turn < most_turns && turn < end; ++turn) {
    const uint64_t now = turn * half_ps;
    if (turn == 1000) *lock = 1;
    if (turn == unlock_at) *lock = 0;
    if (turn == unlock_at + 2000) *lock = 1;
    // The system's clock rises every system_div VCO periods; the host's wires change with it.
    if (turn % (2 * system_div) == 0) {
      const int byte = uart.take(top->ftdi_rxd);
      if (byte >= 0) {
        out.put(static_cast<char>(byte));
        heard += byte == 0;
      }
      if (turn > 20000 && sending.empty() && at < in.size() && heard >= in[at]) {
        const size_t length = in[at + 1] | in[at + 2] << 8;
        sending.assign(in.begin() + at + 3, in.begin() + at + 3 + length);
        at += 3 + length;
      }
      if (uart.ready() && !sending.empty()) {
        uart.send(sending.front());
        sending.pop_front();
      }
      top->ftdi_txd = uart.wire();
      if (at >= in.size() && heard >= number("replies") && end == ~0ull) {
        // All is answered: whole frames more, with `lose` after the lock was lost.
        if (number("lose") && unlock_at == ~0ull) {
          unlock_at = turn + 2;
          end = turn + 4000 + 3 * frame_turns;
        } else {
          end = turn + 3 * frame_turns;
        }
      }
    }
    top->clk_25mhz = !top->clk_25mhz;
    while (!to_board.empty() && to_board.front().first <= now) {
      dq = to_board.front().second;
      to_board.pop_front();
    }
    // What nobody drives is whatever it was.
    top->sdram_d = dq;
    top->eval();
    context->time(now);
    SdramPins pins;
    pins.cke = top->sdram_cke;
    pins.cs_n = top->sdram_csn;
    pins.ras_n = top->sdram_rasn;
    pins.cas_n = top->sdram_casn;
    pins.we_n = top->sdram_wen;
    pins.ba = top->sdram_ba;
    pins.a = top->sdram_a;
    pins.dqm = top->sdram_dqm;
    pins.oe = top->sdram_d__en == 0xffff;
    pins.dq = top->sdram_d__out;
    if (top->sdram_d__en != 0 && top->sdram_d__en != 0xffff) std::printf("violation: half a word is driven\n");
    to_chip.push_back({now + pad_ps, pins, static_cast<bool>(top->sdram_clk)});
    while (to_chip.front().when <= now) {
      const Later& one = to_chip.front();
      if (one.clock && !chip_clock) {
        chip.edge(one.when, one.pins);
        // A word is gone tOH after the edge that captures it; the next one is there tAC after it.
        to_board.push_back({one.when + 2700, 0xdead});
        if (chip.driving()) to_board.push_back({one.when + 5400, chip.dq()});
      }
      chip_clock = one.clock;
      to_chip.pop_front();
    }
    // A bit of each pair lasts half a shift clock: seen at its end.
    if (turn % shift_div == shift_div - 1 && receiver.bit(top->gpdi_dp)) {
      const dvi::Pixel& pixel = receiver.pixel();
      if (!pixel.de && !pixel.vsync && !in_sync) {
        last_frame.swap(frame);
        frame.clear();
      }
      in_sync = !pixel.de && !pixel.vsync;
      if (pixel.de)
        for (int shift : {16, 8, 0}) frame.push_back(static_cast<char>(pixel.rgb >> shift));
    }
  }
  video.write(last_frame.data(), static_cast<std::streamsize>(last_frame.size()));
  std::printf("led=%d\nreplies=%llu\nturns=%llu\nreads=%llu\n", top->led, (unsigned long long)heard,
              (unsigned long long)turn, (unsigned long long)chip.reads());
  std::printf("counts={%s}\n", receiver.counts().c_str());
  if (!chip.violations().empty()) std::printf("first=%llu\n", (unsigned long long)(chip.first_violation() / half_ps));
  for (const auto& [name, count] : chip.violations())
    std::printf("violation: %s: %llu\n", name.c_str(), (unsigned long long)count);
  top->final();
  return 0;
}
