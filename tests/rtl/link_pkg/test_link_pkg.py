"""link_pkg: its CRC is zlib's."""

from runner import run_cocotb

BENCH = """
module crc_bench(
  input  logic [31:0] crc_i,
  input  logic [31:0] word_i,
  output logic [31:0] byte_o,
  output logic [31:0] pixel_o,
  output logic [31:0] word_o,
  output logic [31:0] start_o
);
  assign start_o = lipp_link_pkg::CrcStart;
  assign byte_o = lipp_link_pkg::crc32_byte(crc_i, word_i[7:0]);
  assign pixel_o = lipp_link_pkg::crc32_pixel(crc_i, word_i[23:0]);
  assign word_o = lipp_link_pkg::crc32_word(crc_i, word_i);
endmodule
"""


def test_link_pkg():
    run_cocotb("crc_bench", bench=BENCH, tests="cocotb_link_pkg")
