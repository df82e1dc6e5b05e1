// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes the CRC-32 of a frame's exit rays, so that a host with a slow link can check a frame.
///
/// Each ray has nine words of 32 bits, word 0 in the lowest bits. The CRC processes the low byte of
/// each word first. A ray takes nine clocks. Input start_i restarts the CRC, and the CRC does not
/// include a ray accepted in the clock of start_i. Output done_o is high from the end of the
/// frame's last ray until the next start_i.
module lipp_ray_signature (
  input  logic              clk_i,
  input  logic              rst_ni,
  input  logic              start_i,
  input  logic              ray_valid_i,
  output logic              ray_ready_o,
  input  logic [8:0][31:0]  ray_i,
  input  logic              ray_last_i,
  output logic              done_o,
  output logic [31:0]       rays_o,
  output logic [31:0]       crc_o
);
  import lipp_link_pkg::*;

  logic [7:0][31:0] later_words_q;  // words of the ray after the current word
  logic [31:0] word_q, crc_q;
  logic [3:0] words_q;       // number of words left to process, including the current word
  logic last_q, take;
  assign take = ray_valid_i && ray_ready_o;
  assign crc_o = ~crc_q;

  always_ff @(posedge clk_i) begin
    if (take) {last_q, later_words_q, word_q} <= {ray_last_i, ray_i};
    else {later_words_q, word_q} <= {32'd0, later_words_q};
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      words_q <= '0;
      ray_ready_o <= 1'b1;
      crc_q <= '1;
      rays_o <= '0;
      done_o <= 1'b0;
    end else if (start_i) begin
      words_q <= '0;
      ray_ready_o <= 1'b1;
      crc_q <= '1;
      rays_o <= '0;
      done_o <= 1'b0;
    end else begin
      ray_ready_o <= !take && words_q <= 4'd2;  // high if words_q will be 1 or 0 in the next clock
      if (take) begin
        words_q <= 4'd9;
        rays_o <= rays_o + 1'b1;
      end else if (words_q != '0) begin
        words_q <= words_q - 1'b1;
      end
      if (words_q != '0) crc_q <= crc32_word(crc_q, word_q);
      if (words_q == 4'd1 && last_q) done_o <= 1'b1;
    end
  end

endmodule

`default_nettype wire
