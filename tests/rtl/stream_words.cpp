// Streams words through the bench of bench.py. Standard input holds 32-bit words: for each segment the number of its
// module, how many words it has, its configuration, and its words. Standard output gets as many words from the module.
#include <cstdint>
#include <cstdio>
#include <vector>

#include "Vtop.h"
#include "verilated.h"

int main(int argc, char** argv) {
    Verilated::commandArgs(argc, argv);
    Vtop bench;
    bench.clk_i = 0;
    bench.eval();
    // Inputs change, and outputs are read, between the rising edges.
    const auto clock = [&] {
        bench.clk_i = 1;
        bench.eval();
        bench.clk_i = 0;
        bench.eval();
    };
    constexpr size_t in = sizeof(bench.word_i) / 4, out = sizeof(bench.word_o) / 4;
    std::vector<uint32_t> words, got;
    for (uint32_t head[2]; std::fread(head, 4, 2, stdin) == 2;) {
        bench.select_i = head[0];
        const size_t count = head[1];
        words.resize(count * in);
        if (std::fread(bench.config_i.data(), sizeof(bench.config_i), 1, stdin) != 1) return 2;
        if (std::fread(words.data(), 4, words.size(), stdin) != words.size()) return 2;
        // The optics change only when no ray is on the way.
        clock();
        // Two more for the bench's own registers, before and behind the module.
        const size_t latency = bench.latency_o + 2;
        for (size_t k = 0; k < latency; ++k) clock();
        for (size_t k = 0; k + 1 < count + latency; ++k) {
            for (size_t w = 0; w < in; ++w) bench.word_i.at(w) = words[(k < count ? k : 0) * in + w];
            clock();
            // What is due now came in `latency` clocks ago, this one counted.
            if (k + 1 < latency) continue;
            for (size_t w = 0; w < out; ++w) got.push_back(bench.word_o.at(w));
        }
    }
    bench.final();
    return std::fwrite(got.data(), 4, got.size(), stdout) == got.size() ? 0 : 2;
}
