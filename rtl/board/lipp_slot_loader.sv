// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Writes blocks of 1024 bytes into a texture slot, and stores the CRC-32 of each block.
///
/// Input start_i samples slot_i and block_i, which must exist (slot 15, the panel's curve, has 8
/// blocks). The words of the block are read from a memory: word_i is the word at word_at_o, two
/// clocks later. One byte is written per clock, the low byte of a word first: byte k of block n is
/// byte 1024 n + k of the slot. Output done_o is a pulse 1030 clocks after start_i.
///
/// A table stores, for each block, the CRC-32 of its written bytes. An entry is 0 from start_i
/// until its block is complete. An entry is also 0 if its block was not written since reset. The
/// entries of slot 15, the panel's curve, follow the entries of the last texture slot. Reset clears
/// the table, one entry per clock. While the table is cleared, busy_o is high, start_i must stay
/// low, and reads are undefined. Output read_crc_o(t) is the entry at read_slot_i(t - 2) and
/// read_at_i(t - 2), as it was before clock t - 2.
module lipp_slot_loader #(
  parameter int Slots = 5,    // number of slots, 1 to 15
  parameter int Blocks = 49   // number of blocks per slot, 1 to 256
) (
  input  logic        clk_i,
  input  logic        rst_ni,

  input  logic        start_i,
  input  logic [3:0]  slot_i,
  input  logic [7:0]  block_i,
  output logic [7:0]  word_at_o,
  input  logic [31:0] word_i,
  output logic        done_o,

  output logic        write_o,       // write_*: to the write port of lipp_scene
  output logic [3:0]  write_slot_o,
  output logic [19:0] write_at_o,
  output logic [7:0]  write_data_o,

  output logic        busy_o,
  input  logic [3:0]  read_slot_i,
  input  logic [7:0]  read_at_i,
  output logic [31:0] read_crc_o
);
  import lipp_link_pkg::CrcStart, lipp_link_pkg::crc32_byte;

  localparam int CurveBlocks = 8;
  localparam int BlockBits = $clog2(Blocks > CurveBlocks ? Blocks : CurveBlocks);
  localparam int SlotBits = $clog2(Slots + 1);
  localparam int AddressBits = SlotBits + BlockBits;

  if (Slots < 1 || Slots > 15 || Blocks < 1 || Blocks > 256) begin : gen_illegal
    $fatal(1, "lipp_slot_loader: Slots must be 1 to 15, and Blocks 1 to 256");
  end

  function automatic logic [SlotBits-1:0] row(logic [3:0] slot);
    return slot == 4'd15 ? SlotBits'(Slots) : SlotBits'(slot);
  endfunction

  // ---- write bytes: the word of byte byte_q arrives two clocks after its request ----
  logic [9:0] byte_q;
  logic asking_q, asking_q2, data_valid_q;
  logic [9:0] asked_at_q, at_q;
  logic [3:0] slot_q;
  logic [7:0] block_q;
  assign word_at_o = byte_q[9:2];
  assign write_slot_o = slot_q;
  always_ff @(posedge clk_i) begin
    if (start_i) {slot_q, block_q} <= {slot_i, block_i};
    byte_q <= asking_q ? byte_q + 1'b1 : '0;
    {at_q, asked_at_q} <= {asked_at_q, byte_q};
    {write_at_o, write_data_o} <= {2'd0, block_q, at_q, word_i[8*at_q[1:0]+:8]};
  end

  // ---- compute the CRC-32 of the written bytes ----
  logic written_q, ended_q;
  logic [31:0] crc_q;
  always_ff @(posedge clk_i) begin
    if (start_i) crc_q <= CrcStart;
    else if (write_o) crc_q <= crc32_byte(crc_q, write_data_o);
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {asking_q, asking_q2, data_valid_q, write_o, written_q, ended_q, done_o} <= '0;
    end else begin
      asking_q <= start_i || (asking_q && byte_q != '1);
      asking_q2 <= asking_q;
      data_valid_q <= asking_q2;
      write_o <= data_valid_q;
      written_q <= write_o;
      ended_q <= written_q && !write_o;
      done_o <= ended_q;
    end
  end

  // ---- store the CRC-32 of each block ----

  // number of table entries cleared since reset; the top bit is high when all are cleared
  logic [AddressBits:0] cleared_q;
  assign busy_o = !cleared_q[AddressBits];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) cleared_q <= '0;
    else if (busy_o) cleared_q <= cleared_q + 1'b1;
  end
  lipp_memory_1w1r #(.Width(32), .AddressBits(AddressBits)) i_table (
    .clk_i, .write_i(busy_o || start_i || ended_q),
    .write_at_i(busy_o ? cleared_q[AddressBits-1:0]
                : start_i ? {row(slot_i), block_i[BlockBits-1:0]}
                          : {row(slot_q), block_q[BlockBits-1:0]}),
    .write_data_i(busy_o || start_i ? '0 : ~crc_q),
    .read_at_i({row(read_slot_i), read_at_i[BlockBits-1:0]}), .read_data_o(read_crc_o)
  );
  logic unused_at;
  assign unused_at = ^read_at_i;

endmodule

`default_nettype wire
