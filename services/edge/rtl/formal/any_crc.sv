// In the CRC's place for proofs that hold whatever it is.
module bpn_crc32 (
    input logic clk,
    input logic clear,
    input logic enable,
    input logic [31:0] word,
    output logic [31:0] crc
);
  (* anyseq *) logic [31:0] any;
  assign crc = any;
  wire unused = &{1'b0, clk, clear, enable, word};
endmodule
