// CRC-32 (IEEE 802.3, as zlib's) of a stream of 32-bit words, lowest byte first.
module bpn_crc32 (
    input logic clk,
    input logic clear,  // begins anew; with `enable`: with this word
    input logic enable,
    input logic [31:0] word,
    output logic [31:0] crc
);
  logic [31:0] state;

  function automatic logic [31:0] next(input logic [31:0] value);
    next = value;
    for (int i = 0; i < 32; i = i + 1) next = {1'b0, next[31:1]} ^ (next[0] ? 32'hEDB88320 : 32'h0);
  endfunction

  assign crc = ~state;
  always_ff @(posedge clk)
    if (enable) state <= next((clear ? '1 : state) ^ word);
    else if (clear) state <= '1;
endmodule
