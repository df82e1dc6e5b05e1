// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Compares every exit ray of `board`, bit for bit, with expected.mem, the exit rays of Lippmann's
/// integer twin. The receiver pauses at random; +seed=N sets the seed of the pauses.
module testbench;
  import display_pkg::*;

  localparam int Rays = Columns * Rows;
  localparam int Bits = 2 * lipp_optics_pkg::IndexBits + 3 * (F + 4) + 3 * (F + 2) + 3;

  logic clk = 1'b0;
  logic rst_n = 1'b0;
  logic valid, last, lost;
  logic ready = 1'b0;
  logic signed [lipp_optics_pkg::IndexBits-1:0] i, j;
  logic signed [F+3:0] x, y, z;
  logic signed [F+1:0] dx, dy, dz;
  lipp_optics_pkg::ray_status_e status;
  board dut (
    .clk_i(clk), .rst_ni(rst_n), .exit_valid_o(valid), .exit_ready_i(ready), .exit_i_o(i),
    .exit_j_o(j), .exit_x_o(x), .exit_y_o(y), .exit_z_o(z), .exit_dx_o(dx), .exit_dy_o(dy),
    .exit_dz_o(dz), .exit_status_o(status), .exit_last_o(last),
    .lost_o(lost)
  );

  always #5 clk = !clk;

  logic [Bits-1:0] expected[Rays];
  int seed = 1;
  int count = 0;
  int patience = 100 * Rays;
  initial begin
    void'($value$plusargs("seed=%d", seed));
    void'($urandom(seed));
    $readmemh("expected.mem", expected);
    repeat (3) @(negedge clk);
    rst_n = 1'b1;
    while (count < Rays) begin
      @(negedge clk);
      ready = $urandom_range(2) != 0;
      #1;
      if (valid && ready) begin
        if ({i, j, x, y, z, dx, dy, dz, status} !== expected[count] ||
            last != (count == Rays - 1)) begin
          $fatal(1, "ray %0d: %h, not %h", count, {i, j, x, y, z, dx, dy, dz, status},
                 expected[count]);
        end
        count++;
      end
      patience--;
      if (patience == 0) $fatal(1, "%0d rays came, not %0d", count, Rays);
    end
    repeat (3) @(negedge clk);
    if (lost) $fatal(1, "the last ray is lost");
    $display("%0d rays as expected", Rays);
    $finish;
  end

endmodule

`default_nettype wire
