// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Prints the latency of a build during elaboration, for the report of place-and-route.
module latency #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare
);

  $info("ray_latency = %0d", lipp_optics_pkg::ray_latency(Build));

endmodule

`default_nettype wire
