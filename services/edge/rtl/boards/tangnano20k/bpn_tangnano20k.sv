// Sipeed Tang Nano 20K: 27 MHz from the board, the core's clock from a PLL (`gowin_pll` writes bpn_pll when a bitstream
// is built), the serial line of the USB socket, LEDs, which light at 0, for reset, interrupt and line.
module bpn_tangnano20k #(
    parameter int CLOCKS = 18
) (
    input logic clk_27mhz,
    input logic uart_rx,
    output logic uart_tx,
    output logic [5:0] led
);
  logic clk, locked, irq;
  logic [3:0] reset_line;

  bpn_pll u_pll (
      .clock_in(clk_27mhz),
      .clock_out(clk),
      .locked
  );
  always_ff @(posedge clk) reset_line <= {reset_line[2:0], locked};

  bpn_serial #(
      .CLOCKS(CLOCKS)
  ) u_serial (
      .clk,
      .rst_n(reset_line[3]),
      .rx(uart_rx),
      .tx(uart_tx),
      .irq
  );

  assign led = ~{~uart_tx, ~uart_rx, 2'b0, irq, reset_line[3]};
endmodule
