// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Encodes one DVI channel: a byte of a pixel, or two control bits, becomes a symbol of ten bits.
///
/// The latency is 3 clocks. Bit 0 of a symbol is sent first. A byte d of a pixel is encoded as q[0]
/// = d[0], q[k] = q[k-1] ^ d[k], with bit 8 high. If d has more than four ones, or has four ones
/// and d[0] is low, the encoding is q[k] = ~(q[k-1] ^ d[k]), with bit 8 low. The choice between the
/// two encodings limits the number of transitions within q. Then the eight bits are inverted, with
/// bit 9 high, if the inversion brings the numbers of ones and zeros sent since the last control
/// symbol closer together.
///
/// The register balance_q is (ones - zeros) / 2, counted over all symbols since the last control
/// symbol. The balance stays within -4 to 4 (DVI 1.0, section 3).
module lipp_tmds_encoder (
  input  logic       clk_i,
  input  logic       rst_ni,
  input  logic       de_i,       // 1: data_i is a byte of a pixel
  input  logic [7:0] data_i,
  input  logic [1:0] control_i,  // control bits, sent while de_i is low
  output logic [9:0] symbol_o
);

  function automatic logic [3:0] ones(logic [7:0] bits);
    ones = '0;
    for (int k = 0; k < 8; k++) ones += 4'(bits[k]);
  endfunction

  // ---- clock 1: select XOR or XNOR ----
  logic [7:0] data_q;
  logic [3:0] data_ones;
  logic equal_q;  // 1: q is computed with XNOR; 0: with XOR
  logic [2:1] de_q;
  logic [2:1][1:0] control_q;
  assign data_ones = ones(data_i);
  always_ff @(posedge clk_i) begin
    data_q <= data_i;
    equal_q <= data_ones > 4'd4 || (data_ones == 4'd4 && !data_i[0]);
    control_q <= {control_q[1], control_i};
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) de_q <= '0;
    else de_q <= {de_q[1], de_i};
  end

  // ---- clock 2: compute q, and half the difference between its ones and zeros ----
  logic [7:0] sums, sums_q;
  logic plain_q;  // 1: q was computed with XOR; 0: with XNOR
  logic signed [3:0] more_q;
  always_comb begin
    for (int k = 0; k < 8; k++) sums[k] = ^(data_q & 8'(2 ** (k + 1) - 1))
        ^ (equal_q && k % 2 == 1);
  end
  always_ff @(posedge clk_i) begin
    {plain_q, sums_q} <= {!equal_q, sums};
    more_q <= 4'(ones(sums)) - 4'd4;
  end

  // ---- clock 3: invert q to keep the balance small ----
  logic invert;
  logic signed [3:0] balance_q, added;
  assign invert = balance_q == '0 || more_q == '0 ? !plain_q : (balance_q < 0) == (more_q < 0);
  assign added = invert ? $signed({3'd0, plain_q}) - more_q : more_q - $signed({3'd0, !plain_q});
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      symbol_o <= 10'b11_0101_0100;
      balance_q <= '0;
    end else if (de_q[2]) begin
      symbol_o <= {invert, plain_q, invert ? ~sums_q : sums_q};
      balance_q <= balance_q + added;
    end else begin
      unique case (control_q[2])
        2'b00: symbol_o <= 10'b11_0101_0100;
        2'b01: symbol_o <= 10'b00_1010_1011;
        2'b10: symbol_o <= 10'b01_0101_0100;
        2'b11: symbol_o <= 10'b10_1010_1011;
      endcase
      balance_q <= '0;
    end
  end

endmodule

`default_nettype wire
