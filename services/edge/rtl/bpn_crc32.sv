// CRC-32 (IEEE 802.3, as zlib's) of a stream of 32-bit words, lowest byte first. A word is in it two clocks later: what
// it adds is known after the first, since a CRC is linear, next(a ^ b) = next(a) ^ next(b).
module bpn_crc32 (
    input logic clk,
    input logic clear,  // begins anew, after what was before; a word in the same clock is the first
    input logic enable,
    input logic [31:0] word,
    output logic [31:0] crc
);
  logic [31:0] state, of_word;
  logic added;

  function automatic logic [31:0] next(input logic [31:0] value);
    next = value;
    for (int i = 0; i < 32; i = i + 1) next = {1'b0, next[31:1]} ^ (next[0] ? 32'hEDB88320 : 32'h0);
  endfunction

  assign crc = ~state;
  always_ff @(posedge clk) begin
    added <= enable;
    of_word <= next(word);
    if (clear) state <= '1;
    else if (added) state <= next(state) ^ of_word;
  end
endmodule
