// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Stores received packets, checks their CRC-32, and forwards error-free packets without the CRC.
///
/// Each byte is written into memory when it arrives. The bytes of a packet can be read after the
/// packet has ended without an error. After an error the write address returns to the packet's
/// start. The last five bytes stay in registers outside the memory. Therefore the four bytes of the
/// CRC are never stored, and the byte before the CRC can be marked as the packet's last byte.
///
/// A dropped packet is counted once, for the first reason that applies: too long, COBS error, too
/// short, wrong CRC. While the memory is full, the input waits. The remaining bytes of a packet
/// that is already too long are discarded. The first byte of a packet is at the output 4 clocks
/// after its end beat. One byte follows per clock.
module lipp_packet_fifo #(
  parameter int AddressBits = 13
) (
  input  logic       clk_i,
  input  logic       rst_ni,
  input  logic       in_valid_i,
  output logic       in_ready_o,
  input  logic [7:0] in_data_i,
  input  logic       in_end_i,        // 1: end beat without data after a packet
  input  logic       in_bad_i,
  output logic       out_valid_o,
  input  logic       out_ready_i,
  output logic [7:0] out_data_o,
  output logic       out_last_o,
  output logic       accepted_o,      // pulse: a packet was accepted
  output logic       dropped_long_o,  // pulse: dropped, more than MaxPacket bytes
  output logic       dropped_cobs_o,
  output logic       dropped_short_o,
  output logic       dropped_crc_o
);
  import lipp_link_pkg::*;

  typedef logic [AddressBits-1:0] address_t;

  if (2 ** AddressBits < MaxPacket + 4) begin : gen_illegal
    $fatal(1, "lipp_packet_fifo: 2^AddressBits must be MaxPacket + 4 or more");
  end

  // The last-byte flags are in a separate memory, because block memories of widths 8 and 1 need no
  // multiplexers. A word read in the clock of its write is undefined, and is never used.
  (* no_rw_check *) logic [7:0] bytes[1 << AddressBits];
  (* no_rw_check *) logic lasts[1 << AddressBits];
  address_t write_at_q, read_at_q;
  address_t stored_q;                   // end address of the complete packets in memory

  // ---- write received bytes, and check each packet at its end ----
  logic [4:0][7:0] late_q;
  logic [31:0] crc_q;
  logic [LengthBits-1:0] length_q;      // bytes received of the packet, at most MaxPacket + 1
  // The registers too_long_q and late_full_q replace the comparisons length_q > MaxPacket and
  // length_q >= 5, which would be too slow.
  logic too_long_q, late_full_q;
  logic take, write, room_q;
  logic judge_q, right_q, long_q, cobs_q, short_q, good;
  assign in_ready_o = room_q || too_long_q;
  assign take = in_valid_i && in_ready_o;
  assign write = take && late_full_q && !too_long_q;
  assign good = right_q && !long_q && !cobs_q && !short_q;

  always_ff @(posedge clk_i) begin
    if (take && !in_end_i) late_q <= {late_q[3:0], in_data_i};
    if (write) begin
      bytes[write_at_q] <= late_q[4];
      lasts[write_at_q] <= in_end_i;
    end
    // The CRC state is compared one clock after the packet's end, which shortens the timing path.
    right_q <= crc_q == CrcResidue;
    long_q <= too_long_q;
    cobs_q <= in_bad_i;
    short_q <= length_q < LengthBits'(MinPacket);
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      crc_q <= CrcStart;
      length_q <= '0;
      {too_long_q, late_full_q} <= '0;
      write_at_q <= '0;
      stored_q <= '0;
      room_q <= 1'b0;
      judge_q <= 1'b0;
      {accepted_o, dropped_long_o, dropped_cobs_o, dropped_short_o, dropped_crc_o} <= '0;
    end else begin
      if (take) begin
        crc_q <= in_end_i ? CrcStart : crc32_byte(crc_q, in_data_i);
        if (in_end_i) length_q <= '0;
        else if (!too_long_q) length_q <= length_q + LengthBits'(1);
        too_long_q <= !in_end_i && (too_long_q || length_q == LengthBits'(MaxPacket));
        late_full_q <= !in_end_i && (late_full_q || length_q == LengthBits'(4));
      end

      judge_q <= take && in_end_i;
      accepted_o <= judge_q && good;
      dropped_long_o <= judge_q && long_q;
      dropped_cobs_o <= judge_q && !long_q && cobs_q;
      dropped_short_o <= judge_q && !long_q && !cobs_q && short_q;
      dropped_crc_o <= judge_q && !long_q && !cobs_q && !short_q && !right_q;

      // stored_q and write_at_q may change this late, because the next packet writes its first byte
      // at least five clocks after the check of a packet.
      if (judge_q && good) stored_q <= write_at_q;
      if (judge_q && !good) write_at_q <= stored_q;
      else if (write) write_at_q <= write_at_q + address_t'(1);

      // The limit for room_q leaves room for the bytes of two clocks, because room_q is used one
      // clock later. The memory never becomes completely full.
      room_q <= write_at_q - read_at_q < address_t'(2 ** AddressBits - 2);
    end
  end

  // ---- read the bytes of complete packets ----
  logic step, some, byte_valid_q;
  logic [7:0] byte_q;
  logic last_q;
  assign step = !out_valid_o || out_ready_i;
  assign some = read_at_q != stored_q;

  always_ff @(posedge clk_i) begin
    if (step) begin
      {byte_q, last_q} <= {bytes[read_at_q], lasts[read_at_q]};
      {out_data_o, out_last_o} <= {byte_q, last_q};
    end
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {out_valid_o, byte_valid_q} <= '0;
      read_at_q <= '0;
    end else if (step) begin
      {out_valid_o, byte_valid_q} <= {byte_valid_q, some};
      read_at_q <= read_at_q + address_t'(some);
    end
  end

endmodule

`default_nettype wire
