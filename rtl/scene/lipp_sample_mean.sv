// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes the mean of a pixel's 2^SamplesBits samples, which arrive one after another:
///
///   light_o = (sum of light_i + 2^(SamplesBits-1)) >> SamplesBits   for red, green and blue.
///
/// Samples need not arrive in consecutive clocks. The first sample of a frame always begins a
/// pixel, even if the previous pixel is incomplete. Output last_of_pixel_o reports that light_o is
/// a complete pixel. Outputs first_o and last_o report that the pixel contains the frame's first or
/// last sample. The latency of all outputs is mean_latency(SamplesBits) clocks. With one sample per
/// pixel the outputs are the inputs.
module lipp_sample_mean #(
  parameter int SamplesBits = 0  // log2 of the samples per pixel, 0 to 2
) (
  input  logic                                      clk_i,
  input  logic                                      rst_ni,
  input  logic                                      valid_i,
  input  logic                                      first_i,  // 1: first sample of its frame
  input  logic                                      last_i,
  input  logic [2:0][lipp_scene_pkg::LightBits-1:0] light_i,
  output logic                                      last_of_pixel_o,
  output logic                                      first_o,
  output logic                                      last_o,
  output logic [2:0][lipp_scene_pkg::LightBits-1:0] light_o
);
  import lipp_scene_pkg::*;

  if (SamplesBits < 0 || SamplesBits > 2) begin : gen_illegal
    $fatal(1, "lipp_sample_mean: SamplesBits must be 0 to 2");
  end

  if (SamplesBits == 0) begin : gen_one
    assign {last_of_pixel_o, first_o, last_o} = {1'b1, first_i, last_i};
    assign light_o = light_i;
    logic unused_clocks;
    assign unused_clocks = ^{clk_i, rst_ni, valid_i};
  end else begin : gen_some
    localparam int Ws = LightBits + SamplesBits;
    localparam logic [Ws-1:0] Half = Ws'(1) << (SamplesBits - 1);
    logic [SamplesBits-1:0] number_q;  // index of the next sample within its pixel
    logic begins, ends_q, first_q, last_q;
    logic [2:0][Ws-1:0] sum_q;
    assign begins = first_i || number_q == '0;

    always_ff @(posedge clk_i or negedge rst_ni) begin
      if (!rst_ni) number_q <= '0;
      else if (valid_i) number_q <= begins ? SamplesBits'(1) : number_q + 1'b1;
    end
    always_ff @(posedge clk_i) begin
      if (valid_i) begin
        ends_q <= !begins && number_q == '1;
        first_q <= first_i || (!begins && first_q);
        last_q <= last_i || (!begins && last_q);
        for (int c = 0; c < 3; c++) sum_q[c] <= (begins ? Half : sum_q[c]) + Ws'(light_i[c]);
      end
      {last_of_pixel_o, first_o, last_o} <= {ends_q, first_q, last_q};
      for (int c = 0; c < 3; c++) light_o[c] <= sum_q[c][Ws-1:SamplesBits];
    end
    logic unused_sum;
    assign unused_sum = ^{sum_q[2][SamplesBits-1:0], sum_q[1][SamplesBits-1:0],
        sum_q[0][SamplesBits-1:0]};
  end

endmodule

`default_nettype wire
