/// Delays a word by 3 to 17 cycles in a ring memory: q(t) = d(t - Cycles).
///
/// A place is read before it is written and comes round again after Cycles - 1; the register behind
/// adds one. Kept as a module of its own in synthesis, or all rings would share one pointer.
(* keep_hierarchy *)
module ring #(
  parameter int Width = 1,
  parameter int Cycles = 3
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  localparam int Depth = Cycles - 1;
  localparam int PlaceBits = $clog2(Depth);

  if (Cycles < 3 || Cycles > 17) begin : gen_illegal
    $fatal(1, "ring: Cycles must be 3 to 17");
  end

  (* ram_style = "distributed" *) logic [Width-1:0] places[Depth];
  logic [PlaceBits-1:0] place_q;
  initial place_q = '0;  // any place will do, but it must be one of the ring's

  always_ff @(posedge clk_i) begin
    place_q <= place_q == PlaceBits'(Depth - 1) ? '0 : place_q + 1'b1;
    places[place_q] <= d_i;
    q_o <= places[place_q];
  end

endmodule
