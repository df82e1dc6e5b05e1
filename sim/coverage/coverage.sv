// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Writes the line and toggle coverage of a simulation when it ends.
///
/// The file has Verilator's format and is written into the folder that LIPPMANN_COVERAGE names.
/// lippmann.simulation.compilation binds this module to the top; only Verilator reads it. A process
/// may run several models, and one of them several times.
module coverage;

  final $c(
    "static int ended = 0; ",
    "const std::string number = std::to_string(getpid()) + \"-\" ",
    "+ std::to_string(reinterpret_cast<size_t>(&ended)) + \"-\" + std::to_string(ended++); ",
    "const std::string folder = std::getenv(\"LIPPMANN_COVERAGE\"); ",
    "vlSymsp->_vm_contextp__->coveragep()->write((folder + \"/\" + number + \".dat\").c_str());");

endmodule

`default_nettype wire
