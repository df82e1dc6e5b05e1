// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Prints the latency of a build during elaboration, for the report of place-and-route.
module latency #(
  parameter int F = 23,
  parameter int Grid = lipp_optics_pkg::GridSquare,
  parameter int Model = lipp_optics_pkg::ModelExact,
  parameter bit Viewer = 1'b0,
  parameter bit Aims = 1'b0,
  parameter int Walk = 0,
  parameter bit Converge = 1'b0,
  parameter bit Shear = 1'b0
);

  $info("ray_latency = %0d",
        lipp_optics_pkg::ray_latency(F, Grid, Model, Viewer, Aims, Walk, Converge, Shear));

endmodule

`default_nettype wire
