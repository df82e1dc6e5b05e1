// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Splits a request for pixels into transactions of the SDRAM.
///
/// Two pixels are stored as three words: pixels 2k and 2k + 1 of a buffer are the words 3k to 3k +
/// 2 after the start of the buffer's first row. Consecutive rows lie in different banks: the bank
/// is the row number modulo 4. A transaction has at most Block words, all in one row.
///
/// A transaction is offered when the budget, a count of words, is at least the transaction's number
/// of words. The budget starts with Budget words, grows by three words with each pair_i, and
/// shrinks by the words of each transaction. For a read client, the budget is the free room in the
/// client's buffer. For a write client, the budget is the number of words available to write.
///
/// A transaction is offered 3 clocks after the request or the previous transaction was accepted, or
/// 1 clock after the budget is large enough, whichever is later.
module lipp_sdram_splitter
  import lipp_sdram_pkg::*;
#(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int Block = 96,
  parameter int Budget = 0,
  parameter int MaxBudget = 192,  // maximum value that the budget can reach, in words
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,

  input  logic                 valid_i,
  output logic                 ready_o,
  input  logic                 buffer_i,
  input  logic [PlaceBits-1:0] first_i,  // index of the first pixel in the buffer, even
  input  logic [PlaceBits:0]   count_i,  // number of pixels of the request, even, not 0
  input  logic                 pair_i,

  output logic                 valid_o,
  input  logic                 ready_i,
  output transaction_t         transaction_o
);

  localparam int BufferWords = (Width * Height + 1) / 2 * 3;
  localparam int BufferRows = (BufferWords + RowWords - 1) / RowWords;
  localparam int RemainingBits = PlaceBits + 2 > ColumnBits + 1 ? PlaceBits + 2 : ColumnBits + 1;
  localparam int BudgetBits = $clog2(MaxBudget + 1);
  // number of bits of a row number over all banks
  localparam int NumberBits = RowBits + BankBits;

  if (Width < 2 || Width % 2 != 0 || Width > 16383 || Height < 1 || Height > 16383)
  begin : gen_illegal
    $fatal(1, "lipp_sdram_splitter: Width must be even, Width and Height 1 to 16383");
  end
  if (longint'(2) * longint'(BufferRows) > longint'(1 << NumberBits)) begin : gen_large
    $fatal(1, "lipp_sdram_splitter: two frames must fit into the SDRAM's 32768 rows of 512 words");
  end
  if (Block < 1 || Block > RowWords || MaxBudget < Block || Budget > MaxBudget) begin : gen_block
    $fatal(1,
        "lipp_sdram_splitter: Block must be 1 to 512, and MaxBudget at least Block and Budget");
  end

  typedef enum logic [1:0] {Idle, Measure, Wait, Offer} state_e;
  state_e state_q;
  logic [NumberBits-1:0] number_q;
  logic [ColumnBits-1:0] column_q;
  logic [RemainingBits-1:0] remaining_q;  // number of words of the request still to offer
  logic [BudgetBits-1:0] budget_q;
  logic [ColumnBits:0] count_q, in_row, in_block;

  logic [RemainingBits-1:0] first;
  assign first = RemainingBits'(first_i) + RemainingBits'(first_i >> 1);
  assign in_row = (ColumnBits + 1)'(RowWords) - (ColumnBits + 1)'(column_q);
  assign in_block = (ColumnBits + 1)'(remaining_q < RemainingBits'(Block) ? remaining_q
      : RemainingBits'(Block));
  assign ready_o = state_q == Idle;
  assign valid_o = state_q == Offer;
  assign transaction_o = '{
    row: number_q[NumberBits-1:BankBits], bank: number_q[BankBits-1:0], column: column_q,
    count: count_q, last: remaining_q == RemainingBits'(count_q)
  };

  logic pay;
  logic [ColumnBits:0] column_sum;
  assign pay = valid_o && ready_i;
  assign column_sum = (ColumnBits + 1)'(column_q) + count_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Idle;
      budget_q <= BudgetBits'(Budget);
    end else begin
      budget_q <= budget_q + (pair_i ? BudgetBits'(3) : '0) - (pay ? BudgetBits'(count_q) : '0);
      unique case (state_q)
        Idle: if (valid_i) state_q <= Measure;
        Measure: state_q <= Wait;
        Wait: if (budget_q >= BudgetBits'(count_q)) state_q <= Offer;
        default: if (ready_i) state_q <= transaction_o.last ? Idle : Measure;
      endcase
    end
  end
  always_ff @(posedge clk_i) begin
    if (ready_o) begin
      number_q <= NumberBits'(first >> ColumnBits) + (buffer_i ? NumberBits'(BufferRows) : '0);
      column_q <= first[ColumnBits-1:0];
      remaining_q <= RemainingBits'(count_i) + RemainingBits'(count_i >> 1);
    end else if (pay) begin
      number_q <= number_q + NumberBits'(column_sum[ColumnBits]);
      column_q <= column_sum[ColumnBits-1:0];
      remaining_q <= remaining_q - RemainingBits'(count_q);
    end
    if (state_q == Measure) count_q <= in_row < in_block ? in_row : in_block;
  end

endmodule

`default_nettype wire
