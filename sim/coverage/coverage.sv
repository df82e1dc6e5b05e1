// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Writes the line and toggle coverage of a simulation when it ends.
///
/// The coverage file has Verilator's format and is written into the folder that the environment
/// variable LIPPMANN_COVERAGE names. The Python module lippmann.simulation.compilation binds this
/// module to the top; only Verilator reads it. Each coverage file has a unique name, because a
/// process may run several models.
module coverage;

  final $c(
    "static int ended = 0; ",
    "const std::string number = std::to_string(getpid()) + \"-\" ",
    "+ std::to_string(reinterpret_cast<size_t>(&ended)) + \"-\" + std::to_string(ended++); ",
    "const std::string folder = std::getenv(\"LIPPMANN_COVERAGE\"); ",
    "vlSymsp->_vm_contextp__->coveragep()->write((folder + \"/\" + number + \".dat\").c_str());");

endmodule

`default_nettype wire
