// The core behind a serial line: the whole of a board's shell but its clock and its pins.
module bpn_serial #(
    parameter int CLOCKS = 40  // to a bit of the line
) (
    input logic clk,
    input logic rst_n,
    input logic rx,
    output logic tx,
    output logic irq
);
  logic received, send, ready;
  logic [7:0] received_byte, send_byte;
  logic [9:0] awaddr, araddr;
  logic awvalid, awready, wvalid, wready, bvalid, arvalid, arready, rvalid;
  logic [31:0] wdata, rdata;
  logic [1:0] bresp, rresp;
  logic pixels_ready, weights_ready;
  wire unused = &{1'b0, pixels_ready, weights_ready};

  bpn_uart #(
      .CLOCKS(CLOCKS)
  ) u_uart (
      .clk,
      .rst_n,
      .rx,
      .received,
      .received_byte,
      .tx,
      .send,
      .send_byte,
      .ready
  );

  bpn_serial_master u_master (
      .clk,
      .rst_n,
      .received,
      .received_byte,
      .send,
      .send_byte,
      .ready,
      .m_awaddr(awaddr),
      .m_awvalid(awvalid),
      .m_awready(awready),
      .m_wdata(wdata),
      .m_wvalid(wvalid),
      .m_wready(wready),
      .m_bresp(bresp),
      .m_bvalid(bvalid),
      .m_araddr(araddr),
      .m_arvalid(arvalid),
      .m_arready(arready),
      .m_rdata(rdata),
      .m_rresp(rresp),
      .m_rvalid(rvalid)
  );

  bpn_core u_core (
      .aclk(clk),
      .aresetn(rst_n),
      .s_axis_pixels_tdata('0),
      .s_axis_pixels_tvalid(1'b0),
      .s_axis_pixels_tready(pixels_ready),
      .s_axis_pixels_tlast(1'b0),
      .s_axis_weights_tdata('0),
      .s_axis_weights_tvalid(1'b0),
      .s_axis_weights_tready(weights_ready),
      .s_axis_weights_tlast(1'b0),
      .s_axi_awaddr(awaddr),
      .s_axi_awvalid(awvalid),
      .s_axi_awready(awready),
      .s_axi_wdata(wdata),
      .s_axi_wstrb(4'hf),
      .s_axi_wvalid(wvalid),
      .s_axi_wready(wready),
      .s_axi_bresp(bresp),
      .s_axi_bvalid(bvalid),
      .s_axi_bready(1'b1),
      .s_axi_araddr(araddr),
      .s_axi_arvalid(arvalid),
      .s_axi_arready(arready),
      .s_axi_rdata(rdata),
      .s_axi_rresp(rresp),
      .s_axi_rvalid(rvalid),
      .s_axi_rready(1'b1),
      .irq
  );
endmodule
