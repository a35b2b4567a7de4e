// AXI4-Lite's rules of who answers, proven of bpn_axi_lite for any master and any registers behind it: an answer stays and
// does not change until it is taken, there is none that nobody asked for, and every question is answered once.
module axi_lite (
    input logic clk,
    input logic [9:0] awaddr, araddr,
    input logic awvalid, wvalid, bready, arvalid, rready, write_refused, read_ready, read_refused,
    input logic [31:0] wdata, read_data,
    input logic [3:0] wstrb
);
  logic reset_done = 1'b0;
  always_ff @(posedge clk) reset_done <= 1'b1;
  wire rst_n = reset_done;

  logic awready, wready, bvalid, arready, rvalid, write, read;
  logic [1:0] bresp, rresp;
  logic [31:0] rdata, write_data;
  logic [7:0] write_register, read_register;

  bpn_axi_lite u_axi_lite (
      .clk, .rst_n, .s_awaddr(awaddr), .s_awvalid(awvalid), .s_awready(awready), .s_wdata(wdata), .s_wstrb(wstrb),
      .s_wvalid(wvalid), .s_wready(wready), .s_bresp(bresp), .s_bvalid(bvalid), .s_bready(bready), .s_araddr(araddr),
      .s_arvalid(arvalid), .s_arready(arready), .s_rdata(rdata), .s_rresp(rresp), .s_rvalid(rvalid), .s_rready(rready),
      .write, .write_register, .write_data, .write_refused, .read, .read_register, .read_ready, .read_data, .read_refused
  );

  // What is asked and not answered yet.
  logic [2:0] addresses, datas;
  logic [2:0] reads;
  logic was_b, was_r;
  logic [1:0] was_bresp, was_rresp;
  logic [31:0] was_rdata;
  always_ff @(posedge clk)
    if (!rst_n) begin
      {addresses, datas, reads} <= '0;
      {was_b, was_r} <= '0;
    end else begin
      addresses <= addresses + 3'(awvalid && awready) - 3'(bvalid && bready);
      datas <= datas + 3'(wvalid && wready) - 3'(bvalid && bready);
      reads <= reads + 3'(arvalid && arready) - 3'(rvalid && rready);
      was_b <= bvalid && !bready;
      was_bresp <= bresp;
      was_r <= rvalid && !rready;
      was_rresp <= rresp;
      was_rdata <= rdata;
    end

  always_comb
    if (reset_done) begin
      if (was_b) assert (bvalid && bresp == was_bresp);
      if (was_r) assert (rvalid && rresp == was_rresp && rdata == was_rdata);
      if (bvalid) assert (addresses != '0 && datas != '0);
      if (rvalid) assert (reads == 3'd1);
      assert (addresses == 3'(bvalid) + 3'(!awready));
      assert (datas == 3'(bvalid) + 3'(!wready));
      assert (reads == 3'(rvalid || read));
      assert (!(rvalid && read));
      if (write) assert (!bvalid);
    end
endmodule
