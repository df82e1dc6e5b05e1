// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reads and writes ranges of registers, one word after the other.
///
/// Input start_i starts an access. The inputs that describe the access must be stable until done_o.
/// A range of registers is valid if it begins and ends in the same register block. All addresses of
/// a WRITE are checked before the first word is written, so a refused WRITE changes no register.
/// With Layers > 0, the block at 0x400 contains the scene's registers, including the registers of
/// each layer. With Layers = 0 there is no block at 0x400.
///
/// Output done_o is a pulse, and status_o is valid in the same clock. For a WRITE, done_o comes
/// after the last word. For a READ, done_o comes before the first word, and the words read follow
/// as a stream. An address without a register reads as 0.
module lipp_register_access #(
  parameter int Layers = 0
) (
  input  logic                         clk_i,
  input  logic                         rst_ni,
  input  logic                         start_i,
  input  logic                         write_i,
  input  logic [15:0]                  first_i,  // byte address of the first register
  input  logic [8:0]                   count_i,  // number of words, 1 or more
  output logic                         done_o,
  output lipp_link_pkg::reply_status_e status_o,

  output logic [7:0]        word_at_o,      // index of the next word of a WRITE
  input  logic [31:0]       word_i,         // WRITE data word_at_o, two clocks later
  output logic              word_valid_o,   // 1: word_o is a word of a READ
  input  logic              word_ready_i,
  output logic [31:0]       word_o,

  output logic              bus_start_o,
  output logic              bus_write_o,
  output logic [10:0]       bus_at_o,
  output logic [31:0]       bus_word_o,
  input  logic              bus_done_i,
  input  logic [31:0]       bus_word_i,
  input  logic              bus_error_i
);
  import lipp_link_pkg::*;

  if (Layers < 0 || Layers > 8) begin : gen_illegal
    $fatal(1, "lipp_register_access: Layers must be 0 to 8");
  end

  typedef enum logic [2:0] {Idle, Range, Check, Fetch, Fetched, Ask, Wait, Word} state_e;
  state_e state_q;
  logic write_q, board_q, optics_q, scene_q;  // write_q: a WRITE; others: the selected block
  logic [8:0] remaining_q;           // words left to check (WRITE), then left to access
  logic [7:0] at_q;                  // index of the WRITE's current data word
  logic [8:0] register_q;            // word address of the current register
  logic [10:0] address;
  // End: first address after the last register; 0x400, the end of the optics, if Layers = 0.
  localparam logic [10:0] End = 11'(Layers > 0 ? 'h600 + 32 * Layers : 'h400);
  assign address = {register_q, 2'd0};
  assign word_at_o = at_q;
  assign bus_start_o = state_q == Ask;
  assign {bus_write_o, bus_at_o, bus_word_o} = {write_q, address, word_i};
  assign word_valid_o = state_q == Word;

  // first_i and count_i are stable from two clocks before start_i.
  logic [16:0] behind_q;
  logic aligned_q, high_q, top_q;
  always_ff @(posedge clk_i) begin
    behind_q <= {1'b0, first_i} + {6'd0, count_i, 2'd0};
    aligned_q <= first_i[1:0] == '0;
    high_q <= first_i >= 16'h200;
    top_q <= Layers > 0 && first_i >= 16'h400;
    board_q <= aligned_q && behind_q <= 17'h100;
    optics_q <= aligned_q && high_q && behind_q <= 17'h400;
    scene_q <= aligned_q && top_q && behind_q <= 17'h800;
    if (bus_done_i) word_o <= bus_error_i ? '0 : bus_word_i;
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Idle;
      status_o <= StatusOk;
      {write_q, remaining_q, at_q, register_q, done_o} <= '0;
    end else begin
      done_o <= 1'b0;
      case (state_q)
        Idle: if (start_i) begin
          status_o <= StatusOk;
          write_q <= write_i;
          {remaining_q, at_q, register_q} <= {count_i, 8'd0, first_i[10:2]};
          state_q <= Range;
        end
        Range: begin
          state_q <= write_q ? Check : Ask;
          done_o <= !write_q;
          if (!board_q && !optics_q && !scene_q) begin
            status_o <= StatusAddress;
            done_o <= 1'b1;
            state_q <= Idle;
          end
        end
        Check: begin
          register_q <= register_q + 1'b1;
          remaining_q <= remaining_q - 1'b1;
          if (!lipp_board_map_pkg::writable(address) || address >= End) begin
            status_o <= StatusAddress;
            done_o <= 1'b1;
            state_q <= Idle;
          end else if (remaining_q == 9'd1) begin
            {remaining_q, register_q} <= {count_i, first_i[10:2]};
            state_q <= Fetch;
          end
        end
        Fetch: state_q <= Fetched;
        Fetched: state_q <= Ask;
        Ask: state_q <= Wait;
        Wait: if (bus_done_i) begin
          if (write_q) begin
            if (bus_error_i) status_o <= StatusAddress;
            at_q <= at_q + 1'b1;
            register_q <= register_q + 1'b1;
            remaining_q <= remaining_q - 1'b1;
            done_o <= remaining_q == 9'd1;
            state_q <= remaining_q == 9'd1 ? Idle : Fetch;
          end else begin
            state_q <= Word;
          end
        end
        default: if (word_ready_i) begin  // Word
          register_q <= register_q + 1'b1;
          remaining_q <= remaining_q - 1'b1;
          state_q <= remaining_q == 9'd1 ? Idle : Ask;
        end
      endcase
    end
  end

endmodule

`default_nettype wire
