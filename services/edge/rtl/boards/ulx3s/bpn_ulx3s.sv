// Radiona ULX3S: 25 MHz from the board, the core's clock from a PLL (`ecppll` writes bpn_pll when a bitstream is built),
// the serial line of the USB socket, button FIRE1 as reset, LEDs for reset, interrupt and line.
module bpn_ulx3s #(
    parameter int CLOCKS = 40
) (
    input logic clk_25mhz,
    input logic button,
    input logic ftdi_txd,  // what the host sends
    output logic ftdi_rxd,
    output logic [7:0] led,
    output logic wifi_gpio0  // high: the board's ESP32 lets the FPGA be
);
  logic clk, locked, irq;
  logic [3:0] reset_line;

  bpn_pll u_pll (
      .clkin  (clk_25mhz),
      .clkout0(clk),
      .locked
  );
  always_ff @(posedge clk) reset_line <= {reset_line[2:0], locked && !button};

  bpn_serial #(
      .CLOCKS(CLOCKS)
  ) u_serial (
      .clk,
      .rst_n(reset_line[3]),
      .rx(ftdi_txd),
      .tx(ftdi_rxd),
      .irq
  );

  assign led = {ftdi_rxd, ftdi_txd, 4'b0, irq, reset_line[3]};
  assign wifi_gpio0 = 1'b1;
endmodule
