// SPDX-License-Identifier: Apache-2.0
// Models an SDR SDRAM with 4 banks x 8192 rows x 512 columns of 16 bits, according to the data
// sheet of the MT48LC16M16A2.
//
// The model stores words and reports each command that the data sheet does not allow. The model's
// inputs are the time and the pin levels at each rising edge of the clock. The model supports
// bursts of one word. Auto precharge, longer bursts, BURST TERMINATE and SELF REFRESH are reported
// as not modelled. The model treats CKE low as a power-up, after which the controller must repeat
// the initialisation. Setup and hold times are not checked, because they depend on the FPGA's pads.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

// AC characteristics and refresh times of an SDRAM speed grade, in ps.
struct SdramGrade {
  uint64_t ck3, ck2;  // minimum clock periods with CAS latency 3 (ck3) and 2 (ck2)
  uint64_t rcd, rp, ras, ras_max, rc, rfc, rrd, wr;
  uint64_t mrd_clocks = 2;
  uint64_t power_up = 100'000'000;
  uint64_t refresh = 64'000'000'000;
  unsigned rows = 8192;
};
inline const SdramGrade kGrade75{7500,        10000, 20000, 20000, 44000,
                                 120'000'000, 66000, 66000, 15000, 15000};
inline const SdramGrade kGrade7E{7000,        7500,  15000, 15000, 37000,
                                 120'000'000, 60000, 66000, 14000, 14000};
inline const SdramGrade kGrade6A{6000,        10000, 18000, 18000, 42000,
                                 120'000'000, 60000, 60000, 12000, 12000};

// Levels of the SDRAM's pins at a clock edge. Pins with the suffix _n are active low.
struct SdramPins {
  bool cke = true, cs_n = false, ras_n = true, cas_n = true, we_n = true;
  uint8_t ba = 0;
  uint16_t a = 0;
  uint8_t dqm = 0;
  uint16_t dq = 0;
  bool oe = false;  // true: the controller drives dq
};

class Sdram {
 public:
  explicit Sdram(const SdramGrade& grade) : t_(grade), words_(1u << 24), refreshed_(grade.rows) {
    // The contents of an SDRAM after power-up are undefined, so the model's words start with
    // different values, most of them not zero.
    for (size_t k = 0; k < words_.size(); ++k) words_[k] = static_cast<uint16_t>(k * 40503u >> 3);
  }

  // Processes a rising edge of the SDRAM's clock.
  void edge(uint64_t now, const SdramPins& pins) {
    if (edges_ && now - now_ < (cas_ == 2 ? t_.ck2 : t_.ck3)) report("tCK");
    now_ = now;
    ++edges_;
    if (edges_ == 1) powered_ = now;
    // A read word is driven from one edge until the next edge captures the word. The SDRAM releases
    // the pins tHZ after the capturing edge.
    if (pins.oe && (driving_ || drove_)) report("DQ contention");
    drove_ = driving_ != 0;
    // DQM masks the read word that is captured two edges later
    driving_ = next_[0].valid ? 3 & ~dqm_ : 0;
    dq_ = next_[0].word;
    next_[0] = next_[1];
    next_[1] = {};
    dqm_ = pins.dqm;

    if (open_rows_ && now > ras_deadline_) {
      report("tRAS max");
      ras_deadline_ = ~0ull;
    }
    if (ready_ && now > refreshed_[oldest_] + t_.refresh) {
      report("refresh interval");
      refreshed_[oldest_] = now;  // report each overdue refresh only once
      oldest_ = (oldest_ + 1) % t_.rows;
    }
    const int command = pins.cs_n ? kNop : pins.ras_n << 2 | pins.cas_n << 1 | pins.we_n;
    if (!pins.cke) {
      // CKE is low while the controller is in reset; the model treats this level as a power-up.
      if (command != kNop) report("SELF REFRESH: not modelled");
      for (Bank& bank : banks_) bank = {};
      note_rows();
      step_ = kPower;
      ready_ = false;
      powered_ = now;
      return;
    }
    if (command == kNop) return;
    begin(command);
    Bank& bank = banks_[pins.ba & 3];
    switch (command) {
      case kActive:
        active(bank, pins);
        break;
      case kRead:
      case kWrite:
        column(bank, pins, command == kWrite);
        break;
      case kPrecharge:
        precharge(pins);
        break;
      case kRefresh:
        refresh();
        break;
      case kMode:
        mode(pins);
        break;
      default:
        report("BURST TERMINATE: not modelled");
    }
  }

  // Returns the word that the SDRAM drives until the next clock edge. Bit k of driving() is 1 if
  // the SDRAM drives byte k.
  uint16_t dq() const { return dq_; }
  int driving() const { return driving_; }

  // Changes all words, as if the SDRAM had not been refreshed for a long time.
  void lose() {
    for (uint16_t& word : words_) word = static_cast<uint16_t>(~word);
  }

  bool ready() const { return ready_; }  // true after the initialisation sequence
  uint64_t refreshes() const { return refreshes_; }
  uint64_t reads() const { return reads_; }
  uint64_t writes() const { return writes_; }
  uint64_t activations() const { return activations_; }
  // Returns the number of violations by name; first_violation() returns the first violation's time.
  const std::map<std::string, uint64_t>& violations() const { return violations_; }
  uint64_t first_violation() const { return first_violation_; }

 private:
  enum { kMode = 0, kRefresh = 1, kPrecharge = 2, kActive = 3, kWrite = 4, kRead = 5, kNop = 7 };
  enum Step { kPower, kPrecharged, kRefreshed1, kRefreshed2, kReady };
  struct Bank {
    bool open = false;
    uint16_t row = 0;
    // Times of the last ACTIVE, PRECHARGE and WRITE; a flag was_... is true if its time is valid.
    uint64_t active = 0, precharge = 0, write = 0;
    bool was_active = false, was_precharged = false, was_written = false;
  };
  struct Out {
    bool valid = false;
    uint16_t word = 0;
  };

  void report(const std::string& name) {
    if (violations_.empty()) first_violation_ = now_;
    ++violations_[name];
  }
  bool within(bool happened, uint64_t since, uint64_t least) const {
    return happened && now_ < since + least;
  }

  // Checks the rules that apply to every command.
  void begin(int command) {
    if (now_ < powered_ + t_.power_up) report("power-up 100 us");
    if (within(refreshes_ != 0, last_refresh_, t_.rfc)) report("tRFC");
    if (mode_edge_ && edges_ < mode_edge_ + t_.mrd_clocks) report("tMRD");
    if (!ready_ && (command == kActive || command == kRead || command == kWrite))
      report("before initialisation");
  }

  void active(Bank& bank, const SdramPins& pins) {
    ++activations_;
    if (bank.open) report("ACTIVE to an open bank");
    if (within(bank.was_precharged, bank.precharge, t_.rp)) report("tRP");
    if (within(bank.was_active, bank.active, t_.rc)) report("tRC");
    for (const Bank& other : banks_)
      if (&other != &bank && within(other.was_active, other.active, t_.rrd)) report("tRRD");
    if (pins.a >> 13) report("address out of range");
    bank.open = bank.was_active = true;
    bank.active = now_;
    bank.row = pins.a & 8191;
    bank.was_written = false;
    note_rows();
  }

  void column(Bank& bank, const SdramPins& pins, bool write) {
    if (!bank.open) report(write ? "WRITE to a closed bank" : "READ of a closed bank");
    if (within(bank.was_active, bank.active, t_.rcd)) report("tRCD");
    if (pins.a >> 10 & 1) report("auto precharge: not modelled");
    if (pins.a & ~0x5ff) report("address out of range");
    uint16_t& word =
        words_[(static_cast<size_t>(bank.row) << 2 | (&bank - banks_)) << 9 | (pins.a & 511)];
    if (write) {
      ++writes_;
      if (!pins.oe) report("DQ not driven");
      const uint16_t mask = (pins.dqm & 1 ? 0x00ff : 0) | (pins.dqm & 2 ? 0xff00 : 0);
      word = (word & mask) | (pins.dq & ~mask);
      bank.write = now_;
      bank.was_written = true;
    } else {
      ++reads_;
      next_[cas_ == 2 ? 0 : 1] = {true, word};  // the word is captured cas_ edges after READ
    }
  }

  void precharge(const SdramPins& pins) {
    for (int k = 0; k < 4; ++k) {
      Bank& bank = banks_[k];
      if (!(pins.a >> 10 & 1) && k != (pins.ba & 3)) continue;
      if (bank.open) {
        if (now_ < bank.active + t_.ras) report("tRAS min");
        if (within(bank.was_written, bank.write, t_.wr)) report("tWR");
        bank.precharge = now_;
      } else if (!ready_) {
        bank.precharge = now_;
      }
      bank.was_precharged = true;
      bank.open = false;
    }
    note_rows();
    if (step_ == kPower && (pins.a >> 10 & 1)) step_ = kPrecharged;
  }

  void refresh() {
    idle("AUTO REFRESH with an open row");
    if (step_ == kPower)
      report("initialisation: AUTO REFRESH before PRECHARGE ALL");
    else if (step_ == kPrecharged)
      step_ = kRefreshed1;
    else if (step_ == kRefreshed1)
      step_ = kRefreshed2;
    last_refresh_ = now_;
    ++refreshes_;
    refreshed_[oldest_] = now_;
    oldest_ = (oldest_ + 1) % t_.rows;
  }

  void mode(const SdramPins& pins) {
    idle("LOAD MODE REGISTER with an open row");
    if (step_ == kPower) report("initialisation: LOAD MODE REGISTER before PRECHARGE ALL");
    // A second LOAD MODE REGISTER is legal. The first LOAD MODE REGISTER ends the initialisation.
    if (step_ != kReady && step_ != kRefreshed2)
      report("initialisation: fewer than 2 AUTO REFRESH");
    if (pins.a & 7) report("burst longer than 1: not modelled");
    if (pins.ba || pins.a & 0x1d80) report("mode register: reserved bits");
    cas_ = pins.a >> 4 & 7;
    if (cas_ != 2 && cas_ != 3) report("CAS latency");
    mode_edge_ = edges_;
    if (!ready_) refreshed_.assign(t_.rows, now_);
    step_ = kReady;
    ready_ = true;
  }

  // Reports a violation if a bank is open or was closed less than tRP ago.
  void idle(const char* what) {
    for (const Bank& bank : banks_) {
      if (bank.open)
        report(what);
      else if (within(bank.was_precharged, bank.precharge, t_.rp))
        report("tRP");
    }
  }

  void note_rows() {
    open_rows_ = 0;
    ras_deadline_ = ~0ull;
    for (const Bank& bank : banks_)
      if (bank.open) {
        ++open_rows_;
        if (bank.active + t_.ras_max < ras_deadline_) ras_deadline_ = bank.active + t_.ras_max;
      }
  }

  SdramGrade t_;
  std::vector<uint16_t> words_;
  Bank banks_[4];
  Step step_ = kPower;
  bool ready_ = false;
  unsigned cas_ = 3;
  uint64_t now_ = 0, edges_ = 0, powered_ = 0, mode_edge_ = 0, last_refresh_ = 0;
  uint64_t refreshes_ = 0, reads_ = 0, writes_ = 0, activations_ = 0;
  int open_rows_ = 0;
  uint64_t ras_deadline_ = ~0ull;
  std::vector<uint64_t> refreshed_;  // ring of the times of the last `rows` refreshes
  unsigned oldest_ = 0;
  Out next_[2];  // words that will be driven from the next two edges on
  uint16_t dq_ = 0;
  int driving_ = 0;
  uint8_t dqm_ = 0;
  bool drove_ = false;
  std::map<std::string, uint64_t> violations_;
  uint64_t first_violation_ = 0;
};
