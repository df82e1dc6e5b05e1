// Command sequences for the model of the SDRAM: legal ones, and one that breaks each of its rules.
//
//   model CASE   prints the names of the violations, one a line; model alone prints the cases' names
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <string>

#include "../../../sim/board/sdram.h"

namespace {

// At 125 MHz and grade -75: tRCD 3 clocks, tRP 3, tRAS 6, tRC 9, tRFC 9, tRRD 2, tWR 2, tMRD 2.
struct Bench {
  explicit Bench(const SdramGrade& grade) : chip(grade) {}
  Sdram chip;
  uint64_t now = 5'000'000, period = 8000;

  void edge(const SdramPins& pins) {
    chip.edge(now, pins);
    now += period;
  }
  void command(int ras_cas_we, unsigned bank = 0, unsigned a = 0, uint16_t dq = 0, bool oe = false, int dqm = 0) {
    SdramPins pins;
    pins.ras_n = ras_cas_we >> 2 & 1;
    pins.cas_n = ras_cas_we >> 1 & 1;
    pins.we_n = ras_cas_we & 1;
    pins.ba = static_cast<uint8_t>(bank);
    pins.a = static_cast<uint16_t>(a);
    pins.dq = dq;
    pins.oe = oe;
    pins.dqm = static_cast<uint8_t>(dqm);
    edge(pins);
  }
  void nop(int count = 1, int dqm = 0) { while (count-- > 0) command(7, 0, 0, 0, false, dqm); }
  void active(unsigned bank, unsigned row) { command(3, bank, row); }
  void read(unsigned bank, unsigned column, int dqm = 0) { command(5, bank, column, 0, false, dqm); }
  void write(unsigned bank, unsigned column, uint16_t word, int dqm = 0) { command(4, bank, column, word, true, dqm); }
  void precharge(unsigned bank) { command(2, bank, 0); }
  void precharge_all() { command(2, 0, 1 << 10); }
  void refresh() { command(1); }
  void mode(unsigned a) { command(0, 0, a); }

  void power_up() { nop(12501); }
  void begin() {  // each time the least that is allowed
    power_up();
    precharge_all();
    nop(2);
    refresh();
    nop(8);
    refresh();
    nop(8);
    mode(0x30);
    nop(1);
  }
  void expect(bool good, const char* what) {
    if (!good) std::printf("error: %s\n", what);
  }
};

// An open row, with all times but tRAS max behind it.
void open_row(Bench& b) {
  b.begin();
  b.active(1, 77);
  b.nop(20);
}

const std::map<std::string, std::function<void(Bench&)>> kCases = {
    {"legal", [](Bench& b) {
       b.begin();
       b.active(2, 8191);
       b.nop(2);
       b.write(2, 511, 0x1234);
       b.write(2, 0, 0xabcd);
       b.write(2, 1, 0xffff);
       b.write(2, 1, 0x0000, 1);  // the upper byte only
       b.nop(1);
       b.precharge(2);
       b.nop(2);
       b.active(2, 8191);
       b.nop(1);
       b.active(3, 8191);
       b.nop(2);
       b.read(2, 511);
       b.read(2, 0);
       b.read(2, 1);
       b.expect(b.chip.driving() == 3 && b.chip.dq() == 0x1234, "the first word after two clocks, for the third");
       b.nop(1, 3);  // masks the word that is captured two clocks from now: that of the third read
       b.expect(b.chip.driving() == 3 && b.chip.dq() == 0xabcd, "the second word");
       b.nop(1);
       b.expect(b.chip.driving() == 0, "the third word is masked");
       b.nop(1);
       b.read(2, 1);
       b.nop(2);
       b.expect(b.chip.driving() == 3 && b.chip.dq() == 0x00ff, "a byte was masked when it was written");
       b.nop(3);
       b.expect(b.chip.driving() == 0, "nothing is driven any more");
       b.read(2, 511);
       b.nop(4);
       b.write(2, 3, 0x5555);  // two clocks after the word was captured
       b.nop(1);
       b.precharge_all();
       b.nop(2);
       b.refresh();
       b.nop(8);
       b.active(0, 0);
       b.nop(14990);  // nearly 120 us
       b.precharge(0);
       b.nop(2);
       b.mode(0x20);  // CAS latency 2, with a slower clock
       b.period = 10000;
       b.now += 10000;
       b.nop(1);
       b.active(2, 8191);
       b.nop(1);
       b.read(2, 3);
       b.nop(1);
       b.expect(b.chip.driving() == 3 && b.chip.dq() == 0x5555, "CAS latency 2");
       b.expect(b.chip.reads() == 6 && b.chip.writes() == 5 && b.chip.refreshes() == 3, "counts");
     }},
    {"legal: refreshes every 7.8 us", [](Bench& b) {
       b.begin();
       for (int k = 0; k < 9000; ++k) {
         b.now += 7'800'000 - 9 * b.period;
         b.refresh();
         b.nop(8);
       }
     }},
    {"legal: 8192 refreshes at once, every 63.9 ms", [](Bench& b) {
       b.begin();
       for (int turn = 0; turn < 3; ++turn) {
         b.now += 63'900'000'000 - 8192 * 9 * b.period;
         for (int k = 0; k < 8192; ++k) {
           b.refresh();
           b.nop(8);
         }
       }
     }},
    {"tCK", [](Bench& b) { b.begin(); b.now -= 600; b.nop(1); }},
    {"tCK: latency 2", [](Bench& b) { b.begin(); b.mode(0x20); b.nop(2); }},
    {"tRCD", [](Bench& b) { b.begin(); b.active(0, 0); b.nop(1); b.read(0, 0); }},
    {"tRCD: write", [](Bench& b) { b.begin(); b.active(0, 0); b.nop(1); b.write(0, 0, 0); }},
    {"tRP", [](Bench& b) { open_row(b); b.precharge(1); b.nop(1); b.active(1, 0); }},
    {"tRP: refresh", [](Bench& b) { open_row(b); b.precharge_all(); b.nop(1); b.refresh(); }},
    {"tRP: mode", [](Bench& b) { open_row(b); b.precharge(1); b.nop(1); b.mode(0x30); }},
    {"tRAS min", [](Bench& b) { b.begin(); b.active(0, 0); b.nop(4); b.precharge(0); }},
    {"tRAS max", [](Bench& b) { b.begin(); b.active(0, 0); b.nop(15001); }},
    {"tRC", [](Bench& b) { b.begin(); b.active(0, 0); b.nop(5); b.precharge(0); b.nop(2); b.active(0, 1); }},
    {"tRFC", [](Bench& b) { b.begin(); b.refresh(); b.nop(7); b.active(0, 0); }},
    {"tRFC: refresh", [](Bench& b) { b.begin(); b.refresh(); b.nop(7); b.refresh(); }},
    {"tRRD", [](Bench& b) { b.begin(); b.active(0, 0); b.active(1, 0); }},
    {"tWR", [](Bench& b) { open_row(b); b.write(1, 0, 0); b.precharge(1); }},
    {"tMRD", [](Bench& b) { b.begin(); b.mode(0x30); b.active(0, 0); }},
    {"CAS latency", [](Bench& b) { b.begin(); b.mode(0x10); }},
    {"power-up 100 us", [](Bench& b) { b.nop(12499); b.precharge_all(); }},
    {"power-up 100 us: after CKE was low", [](Bench& b) {
       b.begin();
       SdramPins low;
       low.cke = false;
       b.edge(low);
       b.nop(100);
       b.precharge_all();
     }},
    {"before initialisation", [](Bench& b) { b.power_up(); b.precharge_all(); b.nop(2); b.active(0, 0); }},
    {"before initialisation: after CKE was low", [](Bench& b) {
       b.begin();
       SdramPins low;
       low.cke = false;
       b.edge(low);
       b.power_up();
       b.active(0, 0);
     }},
    {"initialisation: AUTO REFRESH before PRECHARGE ALL", [](Bench& b) { b.power_up(); b.refresh(); }},
    {"initialisation: LOAD MODE REGISTER before PRECHARGE ALL", [](Bench& b) { b.power_up(); b.mode(0x30); }},
    {"initialisation: fewer than 2 AUTO REFRESH", [](Bench& b) {
       b.power_up();
       b.precharge_all();
       b.nop(2);
       b.refresh();
       b.nop(8);
       b.mode(0x30);
     }},
    {"refresh interval", [](Bench& b) { b.begin(); b.now += 64'000'000'000; b.nop(1); }},
    {"refresh interval: every 7.83 us", [](Bench& b) {
       b.begin();
       for (int k = 0; k < 9000; ++k) {
         b.now += 7'830'000 - 9 * b.period;
         b.refresh();
         b.nop(8);
       }
     }},
    {"ACTIVE to an open bank", [](Bench& b) { open_row(b); b.active(1, 78); }},
    {"READ of a closed bank", [](Bench& b) { open_row(b); b.read(0, 0); }},
    {"WRITE to a closed bank", [](Bench& b) { open_row(b); b.precharge(1); b.nop(3); b.write(1, 0, 0); }},
    {"AUTO REFRESH with an open row", [](Bench& b) { open_row(b); b.refresh(); }},
    {"LOAD MODE REGISTER with an open row", [](Bench& b) { open_row(b); b.mode(0x30); }},
    {"DQ contention", [](Bench& b) { open_row(b); b.read(1, 0); b.nop(2); b.write(1, 0, 0); }},
    {"DQ contention: while the chip lets go", [](Bench& b) { open_row(b); b.read(1, 0); b.nop(3); b.write(1, 0, 0); }},
    {"DQ not driven", [](Bench& b) { open_row(b); b.command(4, 1, 0); }},
    {"address out of range", [](Bench& b) { open_row(b); b.read(1, 1 << 9); }},
    {"auto precharge: not modelled", [](Bench& b) { open_row(b); b.read(1, 1 << 10); }},
    {"burst longer than 1: not modelled", [](Bench& b) { b.begin(); b.mode(0x33); }},
    {"mode register: reserved bits", [](Bench& b) { b.begin(); b.mode(0x130); }},
    {"BURST TERMINATE: not modelled", [](Bench& b) { open_row(b); b.command(6); }},
    {"SELF REFRESH: not modelled", [](Bench& b) {
       b.begin();
       SdramPins pins;
       pins.cke = pins.ras_n = pins.cas_n = false;
       b.edge(pins);
     }},
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    for (const auto& [name, run] : kCases) std::printf("%s\n", name.c_str());
    return 0;
  }
  SdramGrade grade = kGrade75;
  if (std::string(argv[1]) == "tRC") grade.rc = 73000;  // grade -75 has it whenever it has tRAS and tRP
  Bench bench(grade);
  kCases.at(argv[1])(bench);
  for (const auto& [name, count] : bench.chip.violations()) std::printf("%s\n", name.c_str());
}
