// A serial line: eight bits, no parity, one stop bit; CLOCKS to a bit.
module bpn_uart #(
    parameter int CLOCKS = 40
) (
    input logic clk,
    input logic rst_n,

    input logic rx,
    output logic received,
    output logic [7:0] received_byte,

    output logic tx,
    input logic send,
    input logic [7:0] send_byte,
    output logic ready
);
  localparam int W = $clog2(CLOCKS);
  logic [1:0] line;  // the receiver's, in this clock domain
  logic [W-1:0] rx_wait, tx_wait;
  logic [3:0] rx_bits, tx_bits;
  logic [8:0] rx_shift;
  logic [9:0] tx_shift;

  assign tx = tx_shift[0];
  assign ready = tx_bits == '0;
  assign received_byte = rx_shift[7:0];

  always_ff @(posedge clk) begin
    line <= {line[0], rx};
    received <= 1'b0;
    if (rx_bits == '0) begin
      rx_wait <= W'(CLOCKS / 2);
      if (!line[1]) rx_bits <= 4'd10;
    end else if (rx_wait != '0) rx_wait <= rx_wait - 1'b1;
    else begin
      rx_wait <= W'(CLOCKS - 1);
      rx_bits <= rx_bits - 1'b1;
      rx_shift <= {line[1], rx_shift[8:1]};
      if (rx_bits == 4'd10 && line[1]) rx_bits <= '0;  // no start bit: noise
      // The stop bit comes last, the shift register's top; without it the byte is none.
      if (rx_bits == 4'd1) received <= line[1];
    end

    if (tx_bits == '0) begin
      if (send) begin
        tx_shift <= {1'b1, send_byte, 1'b0};
        tx_bits <= 4'd10;
        tx_wait <= W'(CLOCKS - 1);
      end
    end else if (tx_wait != '0) tx_wait <= tx_wait - 1'b1;
    else begin
      tx_wait <= W'(CLOCKS - 1);
      tx_bits <= tx_bits - 1'b1;
      tx_shift <= {1'b1, tx_shift[9:1]};
    end

    if (!rst_n) begin
      line <= '1;
      {received, rx_bits, tx_bits} <= '0;
      tx_shift <= '1;
    end
  end
endmodule
