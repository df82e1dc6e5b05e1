// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Writes a block of 1024 bytes into a slot of the scene, and keeps the CRC-32 of each block.
///
/// start_i copies slot and block; the build must have both. The block's words follow from a memory,
/// word_i two clocks after word_at_o. A byte is written each clock, the low one of a word first:
/// byte k of block n is byte 1024 n + k of the slot. done_o is a pulse 1030 clocks after start_i.
///
/// The table holds the CRC-32 of each block as it was written; 0 from start_i until the block is
/// whole, and for one that was not written since the reset. Slot 15, the panel's curve, has the
/// entries behind those of the last slot. Reset clears the table, an entry a clock: busy_o is high
/// meanwhile, nothing may be started, and reads are undefined. read_crc_o(t) is the entry of
/// read_slot_i and read_at_i at t - 2, as written before t - 2.
module lipp_slot_loader #(
  parameter int Slots = 5,    // 1 to 15
  parameter int Blocks = 49   // of a slot: 1 to 256
) (
  input  logic        clk_i,
  input  logic        rst_ni,

  input  logic        start_i,
  input  logic [3:0]  slot_i,
  input  logic [7:0]  block_i,
  output logic [7:0]  word_at_o,
  input  logic [31:0] word_i,
  output logic        done_o,

  output logic        write_o,       // to lipp_scene
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

  // ---- bytes: byte_q is requested, its word comes two clocks later, then it is written ----
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

  // ---- their CRC ----
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

  // ---- the table ----
  logic [AddressBits:0] cleared_q;  // number of cleared entries; the top bit: all
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
