// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Stores bytes in a memory of any depth with a write port and a read port of three clocks latency.
///
/// The memory consists of parts whose depths are powers of two, the largest first, so that few
/// bytes are wasted: a depth of 12288 bytes takes parts of 8192 and 4096 bytes. A remainder of less
/// than 2048 bytes takes one more part. In the third clock, the output of the addressed part is
/// selected. Output read_data_o is undefined for an address of Depth or more.
module lipp_texel_memory #(
  parameter int Depth = 49152,
  localparam int AddressBits = $clog2(Depth)
) (
  input  logic                   clk_i,
  input  logic                   write_i,
  input  logic [AddressBits-1:0] write_at_i,
  input  logic [7:0]             write_data_i,
  input  logic [AddressBits-1:0] read_at_i,
  output logic [7:0]             read_data_o
);

  localparam int LargestBits = 14;  // address bits of the largest part
  localparam int LeastBits = 11;

  if (Depth < 2) begin : gen_illegal
    $fatal(1, "lipp_texel_memory: Depth must be 2 or more");
  end

  /// Return the number of address bits of the first part for the given number of bytes.
  function automatic int first_bits(int bytes);
    if (bytes >= 1 << LargestBits) return LargestBits;
    if (bytes <= 1 << LeastBits) return bytes < 2 ? 1 : $clog2(bytes);
    return $clog2(bytes + 1) - 1;
  endfunction

  /// Return the number of bytes in the parts before part k.
  function automatic int first_of(int k);
    int at;
    at = 0;
    for (int n = 0; n < k; n++) at += 1 << first_bits(Depth - at);
    return at;
  endfunction

  function automatic int parts();
    int at, count;
    at = 0;
    count = 0;
    while (at < Depth) begin
      at += 1 << first_bits(Depth - at);
      count++;
    end
    return count;
  endfunction

  localparam int Parts = parts();
  logic [Parts-1:0][7:0] byte_masked;
  logic [7:0] byte_d;
  for (genvar k = 0; k < Parts; k++) begin : gen_part
    localparam int First = first_of(k);
    localparam int Bits = first_bits(Depth - First);
    logic [7:0] read_data;
    if (Parts == 1) begin : gen_whole
      lipp_memory_1w1r #(.Width(8), .AddressBits(Bits)) i_memory (
        .clk_i, .write_i, .write_at_i, .write_data_i, .read_at_i, .read_data_o(read_data)
      );
      assign byte_masked[k] = read_data;
    end else begin : gen_some
      // First is a multiple of the depth of this part, so the low address bits need no subtraction.
      localparam logic [AddressBits-Bits-1:0] Upper = (AddressBits - Bits)'(First >> Bits);
      logic selected_q, selected_q2;
      lipp_memory_1w1r #(.Width(8), .AddressBits(Bits)) i_memory (
        .clk_i, .write_i(write_i && write_at_i[AddressBits-1:Bits] == Upper),
        .write_at_i(write_at_i[Bits-1:0]), .write_data_i,
        .read_at_i(read_at_i[Bits-1:0]), .read_data_o(read_data)
      );
      always_ff @(posedge clk_i) begin
        selected_q <= read_at_i[AddressBits-1:Bits] == Upper;
        selected_q2 <= selected_q;
      end
      assign byte_masked[k] = read_data & {8{selected_q2}};
    end
  end

  always_comb begin
    byte_d = '0;
    for (int k = 0; k < Parts; k++) byte_d |= byte_masked[k];
  end
  always_ff @(posedge clk_i) read_data_o <= byte_d;

endmodule

`default_nettype wire
