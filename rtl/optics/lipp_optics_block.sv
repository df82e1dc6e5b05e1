// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Traces frames of rays from panel pixels through the lenslets, under control of software.
///
/// The register `source` selects the source of the rays: the raster, or the stream at this block's
/// port. Exit rays leave in the order in which the rays entered. Ports exit_first_o and exit_last_o
/// mark the first and the last ray of a frame.
///
/// Software writes new optics into shadow registers. Writing `apply` requests that the new optics
/// and the new source take effect. Between two frames, new optics take effect at once, otherwise
/// after the frame's last ray was accepted. The register field `busy` is 1 until the apply has
/// taken effect. Writing `start` requests a frame of the raster. While a frame runs, one start is
/// remembered, which takes effect after that frame. Therefore all rays of a frame are traced with
/// the same optics, and a frame uses every apply that was written before its start. Writing `abort`
/// ends the current frame of raster or stream and cancels the remembered start. Rays that were
/// accepted before an abort still leave. A start in the same write as an abort begins a new frame.
///
/// The register port is APB4. A write changes the bytes whose strobe is set. The block ignores the
/// two low address bits and PPROT. The file rtl/registers.rdl defines the registers;
/// docs/reference/optics-block.md explains how software uses them.
module lipp_optics_block #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic                                    clk_i,
  input  logic                                    rst_ni,

  input  logic                                    s_apb_psel,
  input  logic                                    s_apb_penable,
  input  logic                                    s_apb_pwrite,
  input  logic [2:0]                              s_apb_pprot,
  input  logic [8:0]                              s_apb_paddr,  // byte address of a register
  input  logic [31:0]                             s_apb_pwdata,
  input  logic [3:0]                              s_apb_pstrb,
  output logic                                    s_apb_pready,
  output logic [31:0]                             s_apb_prdata,
  output logic                                    s_apb_pslverr,  // 1: address or access is illegal

  input  logic                                         ray_valid_i,
  output logic                                         ray_ready_o,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] ray_u_i,  // pixel u in 1/16 pixel, rightward
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] ray_v_i,  // pixel v in 1/16 pixel, upward
  input  logic signed [F+1:0]                          ray_a_i,  // aperture point a, 2^-F pitches
  input  logic signed [F+1:0]                          ray_b_i,  // aperture point b, 2^-F rows
  input  logic                                         ray_first_i,  // 1: first ray of its frame
  input  logic                                         ray_last_i,  // 1: last ray of its frame

  output logic                                         exit_valid_o,
  input  logic                                         exit_ready_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] exit_i_o,  // lenslet i that the ray leaves
  output logic signed [lipp_optics_pkg::IndexBits-1:0] exit_j_o,
  output logic signed [F+3:0]                          exit_x_o,  // origin x, unit 2^-(F+1) radii
  output logic signed [F+3:0]                          exit_y_o,  // origin y, unit 2^-(F+1) radii
  output logic signed [F+3:0]                          exit_z_o,
  output logic signed [F+1:0]                          exit_dx_o,  // direction x, unit 2^-(F+1)
  output logic signed [F+1:0]                          exit_dy_o,
  output logic signed [F+1:0]                          exit_dz_o,  // direction z; +z to the viewer
  output lipp_optics_pkg::ray_status_e                 exit_status_o,  // status of the ray
  output logic                                         exit_first_o,  // 1: first ray of its frame
  output logic                                         exit_last_o,  // 1: last ray of its frame

  output lipp_optics_pkg::optics_config_t              optics_o  // optics registers as written
);
  import lipp_optics_pkg::*;

  // ---- access the registers and the jitter table ----
  lipp_optics_registers_pkg::optics_registers__in_t status;
  lipp_optics_registers_pkg::optics_registers__out_t hwif_out;
  logic apply_waits, start_waits, abort, busy, running, refused, idle;

  // Addresses in the upper half access the jitter table, which is write-only. The APB response is
  // registered, because the bus master may lie far away on the chip.
  logic registers_ready, registers_error, table_q, table_write;
  logic [31:0] registers_data;
  lipp_optics_registers i_registers (
    .clk(clk_i), .arst_n(rst_ni),
    .s_apb_psel(s_apb_psel && !s_apb_paddr[8] && !s_apb_pready), .s_apb_penable, .s_apb_pwrite,
    .s_apb_pprot, .s_apb_paddr(s_apb_paddr[7:0]), .s_apb_pwdata, .s_apb_pstrb,
    .s_apb_pready(registers_ready), .s_apb_prdata(registers_data),
    .s_apb_pslverr(registers_error), .hwif_in(status), .hwif_out
  );
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {table_q, s_apb_pready} <= '0;
    end else begin
      table_q <= s_apb_psel && !s_apb_penable && s_apb_paddr[8];
      s_apb_pready <= registers_ready || table_q;
    end
  end
  always_ff @(posedge clk_i) begin
    s_apb_prdata <= registers_data;
    s_apb_pslverr <= registers_error || (table_q && !s_apb_pwrite);
  end
  assign table_write = table_q && s_apb_pwrite;

  assign {
    status.build.shear.next, status.build.converge.next, status.build.cross_cells.next,
    status.build.walk.next, status.build.aims.next, status.build.viewer.next,
    status.build.model.next, status.build.grid.next, status.build.fraction_bits.next
  } = Build;
  assign status.status.busy.next = busy || apply_waits;
  assign status.status.running.next = running || start_waits;
  assign status.status.refused.next = refused;
  assign status.status.occupied.next = !idle;

  optics_config_t optics;
  always_comb begin
    optics.x_from_u = {hwif_out.optics.x_from_u_high.value.value,
        hwif_out.optics.x_from_u_low.value.value};
    optics.x_from_v = {hwif_out.optics.x_from_v_high.value.value,
        hwif_out.optics.x_from_v_low.value.value};
    optics.y_from_u = {hwif_out.optics.y_from_u_high.value.value,
        hwif_out.optics.y_from_u_low.value.value};
    optics.y_from_v = {hwif_out.optics.y_from_v_high.value.value,
        hwif_out.optics.y_from_v_low.value.value};
    optics.x_offset = {hwif_out.optics.x_offset_high.value.value,
        hwif_out.optics.x_offset_low.value.value};
    optics.y_offset = {hwif_out.optics.y_offset_high.value.value,
        hwif_out.optics.y_offset_low.value.value};
    optics.slope_x = hwif_out.optics.slope_x.value.value;
    optics.slope_y = hwif_out.optics.slope_y.value.value;
    optics.slope_aim_x = hwif_out.optics.slope_aim_x.value.value;
    optics.slope_aim_y = hwif_out.optics.slope_aim_y.value.value;
    optics.point_x = hwif_out.optics.point_x.value.value;
    optics.point_y = hwif_out.optics.point_y.value.value;
    optics.point_aim_x = hwif_out.optics.point_aim_x.value.value;
    optics.point_aim_y = hwif_out.optics.point_aim_y.value.value;
    optics.index = hwif_out.optics.index.value.value;
    optics.index_square = hwif_out.optics.index_square.value.value;
    optics.index_inverse = hwif_out.optics.index_inverse.value.value;
    optics.index_inverse_square = hwif_out.optics.index_inverse_square.value.value;
    optics.depth = hwif_out.optics.depth.value.value;
    optics.depth_rest = hwif_out.optics.depth_rest.value.value;
    optics.exit_z = hwif_out.optics.exit_z.value.value;
    optics.cell_half = hwif_out.optics.cell_half.value.value;
    optics.cell_pitch_x = hwif_out.optics.cell_pitch_x.value.value;
    optics.cell_pitch_y = hwif_out.optics.cell_pitch_y.value.value;
    optics.cell_half_y = hwif_out.optics.cell_half_y.value.value;
    optics.cell_rise = hwif_out.optics.cell_rise.value.value;
    optics.converge_share = hwif_out.optics_converge.share.value.value;
    optics.converge_x = hwif_out.optics_converge.x.value.value;
    optics.converge_y = hwif_out.optics_converge.y.value.value;
    optics.extent_i = hwif_out.optics_extent.i.value.value;
    optics.extent_j = hwif_out.optics_extent.j.value.value;
    optics.shear_x = hwif_out.optics_shear.x.value.value;
    optics.shear_lean = hwif_out.optics_shear.lean.value.value;
    optics.shear_row = hwif_out.optics_shear.row.value.value;
  end

  assign optics_o = optics;

  raster_config_t window;
  assign window = '{
    first_column: hwif_out.raster.columns.first.value,
        last_column: hwif_out.raster.columns.last.value,
    first_row: hwif_out.raster.rows.first.value, last_row: hwif_out.raster.rows.last.value,
    width: hwif_out.raster.panel.width.value, height: hwif_out.raster.panel.height.value,
    samples: hwif_out.raster.jitter.samples.value,
        jitter: jitter_e'(hwif_out.raster.jitter.mode.value),
    table_first: hwif_out.raster.jitter.table_first.value, seed: hwif_out.raster.seed.value.value
  };

  // ---- select the source of rays ----
  logic walked_valid, walked_ready, walked_first, walked_last;
  logic signed [PixelBits-1:0] walked_u, walked_v;
  logic signed [F+1:0] walked_a, walked_b;
  logic begin_frame;
  lipp_raster #(.F(F)) i_raster (
    .clk_i, .rst_ni, .config_i(window), .start_i(begin_frame), .abort_i(abort),
    .running_o(running), .refused_o(refused),
    .table_write_i({4{table_write}} & s_apb_pstrb), .table_at_i(s_apb_paddr[TableBits+1:2]),
    .table_entry_i(s_apb_pwdata),
    .ray_valid_o(walked_valid), .ray_ready_i(walked_ready),
    .ray_u_o(walked_u), .ray_v_o(walked_v), .ray_a_o(walked_a), .ray_b_o(walked_b),
    .ray_first_o(walked_first), .ray_last_o(walked_last)
  );

  // ---- apply new optics and a new source only between two frames ----
  logic stream, take, valid, ready, first, last;
  logic signed [PixelBits-1:0] u, v;
  logic signed [F+1:0] a, b;
  assign abort = hwif_out.control.abort.value;
  lipp_frame_gate i_gate (
    .clk_i, .rst_ni,
    .apply_i(hwif_out.control.apply.value), .apply_waits_o(apply_waits),
    .stream_i(hwif_out.source.stream.value), .take_o(take), .stream_o(stream),
    .start_i(hwif_out.control.start.value), .start_waits_o(start_waits), .begin_o(begin_frame),
    .abort_i(abort), .raster_running_i(running),
    .raster_valid_i(walked_valid), .raster_ready_o(walked_ready), .raster_last_i(walked_last),
    .stream_valid_i(ray_valid_i), .stream_ready_o(ray_ready_o), .stream_last_i(ray_last_i),
    .valid_o(valid), .ready_i(ready)
  );
  assign {u, v, a, b, first, last} = stream ?
      {ray_u_i, ray_v_i, ray_a_i, ray_b_i, ray_first_i, ray_last_i} :
      {walked_u, walked_v, walked_a, walked_b, walked_first, walked_last};

  // ---- trace the rays ----
  lipp_ray_stream #(.Build(Build)) i_lenslet (
    .clk_i, .rst_ni, .config_i(optics), .apply_i(take), .busy_o(busy), .idle_o(idle),
    .ray_valid_i(valid), .ray_ready_o(ready), .ray_u_i(u), .ray_v_i(v), .ray_a_i(a), .ray_b_i(b),
    .exit_valid_o, .exit_ready_i, .exit_i_o, .exit_j_o, .exit_x_o, .exit_y_o, .exit_z_o,
    .exit_dx_o, .exit_dy_o, .exit_dz_o, .exit_status_o
  );

  // A FIFO in parallel to the pipeline stores the first and last mark of each ray, in order. The
  // FIFO has an entry for each ray in the pipeline. The marks of a ray are written one clock after
  // it was accepted, because the source may lie far away on the chip. A ray needs more than one
  // clock to leave the pipeline.
  localparam int Latency = ray_latency(Build);
  localparam int AddressBits = $clog2(Latency + 16);
  logic exit_taken_q, unused_valid;
  logic [1:0] ends_q;
  always_ff @(posedge clk_i) ends_q <= {first, last};
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) exit_taken_q <= 1'b0;
    else exit_taken_q <= valid && ready;
  end
  lipp_fifo #(.Width(2), .AddressBits(AddressBits)) i_ends (
    .clk_i, .rst_ni, .write_i(exit_taken_q), .data_i(ends_q), .valid_o(unused_valid),
    .ready_i(exit_valid_o && exit_ready_i), .data_o({exit_first_o, exit_last_o})
  );

endmodule

`default_nettype wire
