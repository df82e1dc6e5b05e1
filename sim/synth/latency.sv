// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Prints the latency of a build of the optics during elaboration, for the place-and-route report.
module latency #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare
);

  $info("ray_latency = %0d", lipp_optics_pkg::ray_latency(Build));

endmodule

`default_nettype wire
