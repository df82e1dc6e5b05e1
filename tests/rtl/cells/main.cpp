// Clocks a bench: bench CLOCKS [+verilator+seed+N].
#include <cstdlib>
#include <verilated.h>
#include "Vtop.h"

int main(int argc, char **argv) {
    Verilated::commandArgs(argc, argv);
    Vtop bench;
    const long clocks = std::atol(argv[1]);
    for (long k = 0; k < clocks; ++k) {
        bench.clk_i = 0;
        bench.eval();
        bench.clk_i = 1;
        bench.eval();
    }
    bench.final();
}
