// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Accesses the registers of the board, of the optics block and of the scene, one at a time.
///
/// Input start_i requests an access with write_i, at_i (a byte address, a multiple of 4) and
/// word_i. Output done_o pulses three or more clocks after start_i. In the clock of done_o, word_o
/// is valid for a read, and error_o is high if no register allows the access. done_o and the next
/// start_i may coincide.
///
/// The three register blocks share one APB4 bus with one select signal each. Every write changes a
/// whole word. Addresses outside the three blocks have no register. The address map in bytes is:
///
///   0x000 to 0x07f   The registers of board_registers.
///   0x200 to 0x3ff   The registers of optics_block, at 0x200 plus their own address.
///   0x400 to 0x7ff   The registers of scene_block, at 0x400 plus their own address (Scene = 1).
module lipp_register_bus #(
  parameter bit Scene = 1'b0  // 1: the design has a scene_block
) (
  input  logic        clk_i,
  input  logic        rst_ni,

  input  logic        start_i,
  input  logic        write_i,
  input  logic [10:0] at_i,
  input  logic [31:0] word_i,
  output logic        done_o,
  output logic [31:0] word_o,
  output logic        error_o,

  output logic        m_apb_psel_board,
  output logic        m_apb_psel_optics,
  output logic        m_apb_psel_scene,
  output logic        m_apb_penable,
  output logic        m_apb_pwrite,
  output logic [2:0]  m_apb_pprot,
  output logic [9:0]  m_apb_paddr,
  output logic [31:0] m_apb_pwdata,
  output logic [3:0]  m_apb_pstrb,
  input  logic        m_apb_pready_board,
  input  logic [31:0] m_apb_prdata_board,
  input  logic        m_apb_pslverr_board,
  input  logic        m_apb_pready_optics,
  input  logic [31:0] m_apb_prdata_optics,
  input  logic        m_apb_pslverr_optics,
  input  logic        m_apb_pready_scene,
  input  logic [31:0] m_apb_prdata_scene,
  input  logic        m_apb_pslverr_scene
);

  logic to_scene, to_optics, to_board;
  assign to_scene = Scene && at_i[10];
  assign to_optics = !at_i[10] && at_i[9];
  assign to_board = at_i[10:7] == '0;

  logic scene_q, optics_q, nowhere_q, nowhere_q2, ack, ack_q;
  // The APB4 response of each register block is registered before the multiplexer that selects one.
  logic [31:0] board_word_q, optics_word_q, scene_word_q;
  logic board_error_q, optics_error_q, scene_error_q;
  assign m_apb_pprot = '0;
  assign m_apb_pstrb = {4{m_apb_pwrite}};
  assign ack = m_apb_penable && ((m_apb_psel_board && m_apb_pready_board) ||
                                 (m_apb_psel_optics && m_apb_pready_optics) ||
                                 (m_apb_psel_scene && m_apb_pready_scene));

  always_ff @(posedge clk_i) begin
    if (start_i) begin
      {m_apb_pwrite, m_apb_pwdata} <= {write_i, word_i};
      {scene_q, optics_q} <= {to_scene, to_optics};
      m_apb_paddr <= {at_i[9] && Scene && at_i[10], at_i[8:0]};
    end
    {board_word_q, board_error_q} <= {m_apb_prdata_board, m_apb_pslverr_board};
    {optics_word_q, optics_error_q} <= {m_apb_prdata_optics, m_apb_pslverr_optics};
    {scene_word_q, scene_error_q} <= Scene ? {m_apb_prdata_scene, m_apb_pslverr_scene} : '0;
    word_o <= scene_q ? scene_word_q : optics_q ? optics_word_q : board_word_q;
    error_o <= nowhere_q2 || (scene_q ? scene_error_q : optics_q ? optics_error_q : board_error_q);
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {m_apb_psel_board, m_apb_psel_optics, m_apb_psel_scene, m_apb_penable} <= '0;
      {nowhere_q, nowhere_q2, ack_q, done_o} <= '0;
    end else begin
      m_apb_psel_board <= (start_i && to_board) || (m_apb_psel_board && !ack);
      m_apb_psel_optics <= (start_i && to_optics) || (m_apb_psel_optics && !ack);
      m_apb_psel_scene <= (start_i && to_scene) || (m_apb_psel_scene && !ack);
      m_apb_penable <= (m_apb_psel_board || m_apb_psel_optics || m_apb_psel_scene) && !ack;
      nowhere_q <= start_i && !(to_board || to_optics || to_scene);
      {ack_q, nowhere_q2} <= {ack, nowhere_q};
      done_o <= ack_q || nowhere_q2;
    end
  end

endmodule

`default_nettype wire
