// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Access to the registers of the board and of the optics block, one at a time.
///
/// start_i requests an access with write_i, at_i (byte address, a multiple of 4) and word_i. done_o
/// is a pulse two or more clocks later, valid with word_o of a read, and with error_o if no
/// register allows the access. The next access may start with that pulse. Addresses:
///
///   0x000 to 0x07f   board_registers
///   0x200 to 0x3ff   optics_block, from its address 0 on
///
/// Other addresses are empty.
///
/// The board's registers have PeakRDL's pass-through port (request and acknowledge), the optics
/// block APB4.
module lipp_register_bus (
  input  logic        clk_i,
  input  logic        rst_ni,

  input  logic        start_i,
  input  logic        write_i,
  input  logic [9:0]  at_i,
  input  logic [31:0] word_i,
  output logic        done_o,
  output logic [31:0] word_o,
  output logic        error_o,

  output logic        board_request_o,
  output logic        board_write_o,
  output logic [6:0]  board_at_o,
  output logic [31:0] board_word_o,
  input  logic        board_read_ack_i,
  input  logic        board_write_ack_i,
  input  logic        board_error_i,
  input  logic [31:0] board_word_i,

  output logic        apb_sel_o,
  output logic        apb_enable_o,
  output logic        apb_write_o,
  output logic [8:0]  apb_addr_o,
  output logic [31:0] apb_wdata_o,
  input  logic        apb_ready_i,
  input  logic [31:0] apb_rdata_i,
  input  logic        apb_error_i
);

  logic write_q, optics_q;
  logic [8:0] at_q;
  logic [31:0] word_q;
  logic board_request_q, sel_q, enable_q;

  assign {board_request_o, board_write_o, board_at_o} = {board_request_q, write_q, at_q[6:0]};
  assign {apb_sel_o, apb_enable_o, apb_write_o, apb_addr_o} = {sel_q, enable_q, write_q, at_q};
  assign board_word_o = word_q;
  assign apb_wdata_o = word_q;

  logic board_ack, apb_ack, nowhere_q;
  assign board_ack = board_read_ack_i || board_write_ack_i;
  assign apb_ack = enable_q && apb_ready_i;

  always_ff @(posedge clk_i) begin
    if (start_i) {write_q, optics_q, at_q, word_q} <= {write_i, at_i[9], at_i[8:0], word_i};
    word_o <= optics_q ? apb_rdata_i : board_word_i;
    error_o <= nowhere_q || (optics_q ? apb_error_i : board_error_i);
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {board_request_q, sel_q, enable_q, nowhere_q, done_o} <= '0;
    end else begin
      board_request_q <= start_i && at_i[9:7] == '0;
      nowhere_q <= start_i && !at_i[9] && at_i[8:7] != '0;
      sel_q <= (start_i && at_i[9]) || (sel_q && !apb_ack);
      enable_q <= sel_q && !apb_ack;
      done_o <= board_ack || apb_ack || nowhere_q;
    end
  end

endmodule

`default_nettype wire
