// A binarized policy: pixels in by AXI4-Stream, weight sets by another, registers by AXI4-Lite. One clock, no vendor
// primitive, no multiplier. docs/fpga.md has the picture.
module bpn_core (
    input logic aclk,
    input logic aresetn,

    input logic [8*bpn::BYTES-1:0] s_axis_pixels_tdata,
    input logic s_axis_pixels_tvalid,
    output logic s_axis_pixels_tready,
    input logic s_axis_pixels_tlast,

    input logic [31:0] s_axis_weights_tdata,
    input logic s_axis_weights_tvalid,
    output logic s_axis_weights_tready,
    input logic s_axis_weights_tlast,

    input logic [9:0] s_axi_awaddr,
    input logic s_axi_awvalid,
    output logic s_axi_awready,
    input logic [31:0] s_axi_wdata,
    input logic [3:0] s_axi_wstrb,
    input logic s_axi_wvalid,
    output logic s_axi_wready,
    output logic [1:0] s_axi_bresp,
    output logic s_axi_bvalid,
    input logic s_axi_bready,
    input logic [9:0] s_axi_araddr,
    input logic s_axi_arvalid,
    output logic s_axi_arready,
    output logic [31:0] s_axi_rdata,
    output logic [1:0] s_axi_rresp,
    output logic s_axi_rvalid,
    input logic s_axi_rready,

    output logic irq
);
  localparam int GEOMETRY_W = bpn::GEOMETRY_W;
  wire clk = aclk;
  wire rst_n = aresetn;

  // Registers.
  logic write, write_refused, read, read_ready, read_refused;
  logic [7:0] write_register, read_register;
  logic [31:0] write_data, read_data;
  logic select, select_refused, pixels_push, weights_push, push_last;
  logic [1:0] select_banks, valid, selected, in_use;
  logic [2*GEOMETRY_W-1:0] geometries;
  logic [63:0] epochs, crcs;
  logic [31:0] push_data;
  logic memory_read, memory_ready;
  logic [31:0] memory_address, memory_data;

  wire unused = &{1'b0, memory_address[26:0]};  // how much of it a region needs depends on the build

  // Frames.
  logic start, newest, newest_bank, newest_stacked, full, finish;
  logic flying, oldest, oldest_bank, oldest_misaligned, oldest_alone;
  logic pixels_done, misaligned;
  logic [bpn::G_STACKED-1:0] oldest_geometry;
  wire [GEOMETRY_W-1:0] next_geometry =
      selected[1] ? geometries[GEOMETRY_W+:GEOMETRY_W] : geometries[0+:GEOMETRY_W];
  wire [bpn::GROUP_W-1:0] node_groups = oldest_geometry[bpn::G_NODE_GROUPS+:bpn::GROUP_W];
  wire [bpn::ACTION_GROUP_W-1:0] action_groups = oldest_geometry[bpn::G_ACTION_GROUPS+:bpn::ACTION_GROUP_W];

  bpn_axi_lite u_axi_lite (
      .clk, .rst_n,
      .s_awaddr(s_axi_awaddr),
      .s_awvalid(s_axi_awvalid),
      .s_awready(s_axi_awready),
      .s_wdata(s_axi_wdata),
      .s_wstrb(s_axi_wstrb),
      .s_wvalid(s_axi_wvalid),
      .s_wready(s_axi_wready),
      .s_bresp(s_axi_bresp),
      .s_bvalid(s_axi_bvalid),
      .s_bready(s_axi_bready),
      .s_araddr(s_axi_araddr),
      .s_arvalid(s_axi_arvalid),
      .s_arready(s_axi_arready),
      .s_rdata(s_axi_rdata),
      .s_rresp(s_axi_rresp),
      .s_rvalid(s_axi_rvalid),
      .s_rready(s_axi_rready),
      .write,
      .write_register,
      .write_data,
      .write_refused,
      .read,
      .read_register,
      .read_ready,
      .read_data,
      .read_refused
  );

  // The streams, each with a word that the host may push in.
  logic [8*bpn::BYTES-1:0] pixels;
  logic pixels_valid, pixels_ready, pixels_last, pixels_full;
  logic [31:0] set_word;
  logic set_valid, set_ready, set_last, weights_full;

  bpn_push #(
      .WIDTH(8 * bpn::BYTES)
  ) u_push_pixels (
      .clk, .rst_n,
      .push(pixels_push),
      .push_data((8 * bpn::BYTES)'(push_data)),
      .push_last,
      .full(pixels_full),
      .s_tdata(s_axis_pixels_tdata),
      .s_tvalid(s_axis_pixels_tvalid),
      .s_tready(s_axis_pixels_tready),
      .s_tlast(s_axis_pixels_tlast),
      .m_tdata(pixels),
      .m_tvalid(pixels_valid),
      .m_tready(pixels_ready),
      .m_tlast(pixels_last)
  );

  bpn_push u_push_weights (
      .clk, .rst_n,
      .push(weights_push),
      .push_data,
      .push_last,
      .full(weights_full),
      .s_tdata(s_axis_weights_tdata),
      .s_tvalid(s_axis_weights_tvalid),
      .s_tready(s_axis_weights_tready),
      .s_tlast(s_axis_weights_tlast),
      .m_tdata(set_word),
      .m_tvalid(set_valid),
      .m_tready(set_ready),
      .m_tlast(set_last)
  );

  // Banks.
  logic loading, begun, begun_bank, load_bank, verified;
  logic [3:0] refused;
  logic [GEOMETRY_W-1:0] load_geometry;
  logic [31:0] load_epoch, load_crc, load_data;
  logic [bpn::CONV1_LANES-1:0] conv1_write;
  logic [bpn::BEAT_W+1:0] conv1_address;
  logic threshold_write;
  logic [2:0] threshold_address;
  logic [7:0] engine_write;
  logic [bpn::WEIGHT_W-1:0] engine_address;

  bpn_loader u_loader (
      .clk, .rst_n,
      .s_tdata(set_word),
      .s_tvalid(set_valid),
      .s_tready(set_ready),
      .s_tlast(set_last),
      .selected,
      .in_use,
      .busy(loading),
      .begun,
      .begun_bank,
      .bank(load_bank),
      .verified,
      .geometry(load_geometry),
      .epoch(load_epoch),
      .crc(load_crc),
      .refused,
      .conv1_write,
      .conv1_address,
      .threshold_write,
      .threshold_address,
      .engine_write,
      .engine_address,
      .write_data(load_data)
  );

  bpn_banks u_banks (
      .clk, .rst_n,
      .begun,
      .begun_bank,
      .verified,
      .load_bank,
      .load_geometry,
      .load_epoch,
      .load_crc,
      .select,
      .select_banks,
      .select_refused,
      .valid,
      .selected,
      .geometries,
      .epochs,
      .crcs
  );

  // Pixels and conv1.
  logic hold_pixels, hold_engine;
  logic beat_valid, beat_last;
  logic [8*bpn::BYTES-1:0] beat_data;
  logic [bpn::BEAT_W-1:0] beat;
  logic [bpn::BLOCK_W-1:0] block;
  logic [bpn::ROW_W-1:0] row;

  bpn_frame_gate u_gate (
      .clk, .rst_n,
      .s_tdata(pixels),
      .s_tvalid(pixels_valid),
      .s_tready(pixels_ready),
      .s_tlast(pixels_last),
      .go(selected != '0 && !full),
      .last_beat(next_geometry[bpn::G_LAST_BEAT+:bpn::BEAT_W]),
      .hold(hold_pixels),
      .start,
      .done(pixels_done),
      .misaligned,
      .beat_valid,
      .beat_data,
      .beat,
      .beat_last,
      .block,
      .row
  );

  bpn_flight u_flight (
      .clk, .rst_n,
      .start,
      .start_bank(selected[1]),
      .forget(select),
      .start_geometry(next_geometry[bpn::G_STACKED:0]),
      .end_of_pixels(pixels_done),
      .end_misaligned(misaligned),
      .finish,
      .full,
      .in_use,
      .newest,
      .newest_bank,
      .newest_stacked,
      .active(flying),
      .oldest,
      .oldest_bank,
      .oldest_misaligned,
      .oldest_alone,
      .oldest_geometry
  );

  logic host_conv1, host_engine;
  logic [32*bpn::CONV1_LANES-1:0] host_weights;
  logic [31:0] host_threshold;
  logic map_write, map_half;
  logic [7:0] map_address;
  logic [15:0] map_word;

  bpn_conv1 u_conv1 (
      .clk, .rst_n,
      .beat_valid,
      .beat_data,
      .beat,
      .beat_last,
      .block,
      .row,
      .bank(newest_bank),
      .half(newest),
      .stacked(newest_stacked),
      .write_bank(load_bank),
      .weight_write(conv1_write),
      .weight_address(conv1_address),
      .threshold_write,
      .threshold_address,
      .write_data(load_data),
      .host_read(host_conv1),
      .host_address({memory_address[27], memory_address[$clog2(bpn::CONV1_LANES)+:bpn::BEAT_W+2]}),
      .host_weights,
      .host_threshold_address({memory_address[27], memory_address[2:0]}),
      .host_threshold,
      .map_write,
      .map_half,
      .map_address,
      .map_word
  );

  // The layers after conv1.
  logic idle, output_done;
  logic [7:0] conv1_words[2];
  logic [255:0] weights;
  logic [15:0] conv1_input, maps_input;
  logic [bpn::GROUP_W-1:0] done_group;
  logic [16*bpn::ACC_W-1:0] sums;

  bpn_engine u_engine (
      .clk, .rst_n,
      .active(flying),
      .frame(oldest),
      .bank(oldest_bank),
      .node_groups,
      .action_groups,
      .clear(finish),
      .conv1_words(conv1_words[oldest]),
      .idle,
      .map_write,
      .map_half,
      .map_address,
      .map_word,
      .weight_write(engine_write),
      .write_bank(load_bank),
      .write_address(engine_address),
      .write_data(load_data),
      .hold(hold_engine),
      .host_read(host_engine),
      .host_bank(memory_address[27]),
      .host_frame(newest),
      .host_address(memory_address[bpn::WEIGHT_W+2:0]),
      .weights,
      .conv1_input,
      .maps_input,
      .output_done,
      .done_group,
      .sums
  );

  // How far the frames are.
  logic [31:0] clocks;
  logic [31:0] begun_at[2], ended_at[2];
  wire result = finish && !oldest_misaligned && !oldest_alone;
  wire [bpn::EVENTS-1:0] events = {refused, finish && oldest_misaligned, verified, result};

  always_ff @(posedge clk) begin
    clocks <= clocks + 1'b1;
    finish <= rst_n && output_done && done_group == bpn::GROUP_W'(action_groups) - 1'b1;
    if (start) begin
      begun_at[!newest] <= clocks;
      conv1_words[!newest] <= '0;
    end
    if (pixels_done) ended_at[newest] <= clocks;
    if (map_write) conv1_words[map_half] <= conv1_words[map_half] + 1'b1;
    if (!rst_n) clocks <= '0;
  end

  bpn_memory_reader u_memory_reader (
      .clk,
      .read(memory_read),
      .region(memory_address[31:28]),
      .lane(memory_address[4:0]),
      .ready(memory_ready),
      .data(memory_data),
      .hold_pixels,
      .read_conv1(host_conv1),
      .hold_engine,
      .engine_idle(idle),
      .read_engine(host_engine),
      .conv1_weights(host_weights),
      .conv1_threshold(host_threshold),
      .engine_weights(weights),
      .conv1_map(conv1_input),
      .maps(maps_input)
  );

  bpn_registers u_registers (
      .clk, .rst_n,
      .write,
      .write_register,
      .write_data,
      .write_refused,
      .read,
      .read_register,
      .read_ready,
      .read_data,
      .read_refused,
      .irq,
      .select,
      .select_banks,
      .select_refused,
      .valid,
      .selected,
      .loading,
      .bank_sizes({geometries[GEOMETRY_W+:23], geometries[0+:23]}),
      .epochs,
      .crcs,
      .in_flight(flying),
      .events,
      .result,
      .result_epoch(oldest_bank ? epochs[63:32] : epochs[31:0]),
      .result_sizes(oldest_geometry[22:0]),
      .result_clocks(clocks - begun_at[oldest]),
      .result_tail(clocks - ended_at[oldest]),
      .output_write(output_done),
      .output_group(done_group[1:0]),
      .output_sums(sums),
      .pixels_push,
      .weights_push,
      .push_data,
      .push_last,
      .pixels_full,
      .weights_full,
      .memory_read,
      .memory_address,
      .memory_ready,
      .memory_data
  );
endmodule
