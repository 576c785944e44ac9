/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a hostile peer writes and notifies, up to the leader's estimator and the follower's clock.
 *
 * An input is a list of steps: a byte that chooses the step, then what that step takes. The steps
 * of an honest peer are there so that the state behind a tied clock is reached at all.
 */
#include "check.h"
#include "diag_csv.h"
#include "diag_report.h"
#include "diag_uart.h"
#include "fusion_task.h"
#include "link.h"
#include "node.h"
#include "node_parts.h"
#include "peer.h"
#include "sync_timer.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define STEPS_MAX    48
#define EVENT_TICKS  120000U /* 7.5 ms */
#define FLIGHT_TICKS 300U
#define BATCHES_MAX  60U
#define PERIOD       39384615U /* 104 Hz, in 1/256 tick */

static uint64_t now_ticks;
static uint32_t event;
static uint32_t batches_left;
static uint32_t leader_index;

struct input {
	const uint8_t *bytes;
	size_t left;
};

static uint32_t next(struct input *in, size_t count)
{
	uint32_t value = 0;

	for (size_t i = 0; i < count && in->left > 0U; i++) {
		value |= (uint32_t)*in->bytes << (8U * i);
		in->bytes++;
		in->left--;
	}
	return value;
}

/* ---- What the nodes call ------------------------------------------------------------------- */

uint64_t sync_timer_now_ticks(void)
{
	return now_ticks;
}

static bool is_one_of(uint32_t value, const uint16_t *known, size_t count)
{
	for (size_t i = 0; i < count; i++) {
		if (value == known[i]) {
			return true;
		}
	}
	return false;
}

/* All that reaches stream and estimator is what a sensor can have measured. */
static void check_batch(const struct wire_imu_batch *batch)
{
	static const uint16_t accel_g[] = {2, 4, 8, 16};
	static const uint16_t gyro_dps[] = {125, 250, 500, 1000, 2000};

	CHECK(batch->count >= 1U && batch->count <= WIRE_IMU_BATCH_MAX_COUNT);
	CHECK(is_one_of(batch->accel_fs_g, accel_g, 4));
	CHECK(is_one_of(batch->gyro_fs_dps, gyro_dps, 5));
	/* 6.7 kHz and 12.5 Hz, with room for clocks that are off. */
	CHECK(batch->period_ticks >= 500000U && batch->period_ticks <= 400000000U);
	CHECK(batch->t_first_ticks_node < now_ticks + 16U * 1000U + 1U);
}

void fusion_take(const struct wire_imu_batch *batch)
{
	check_batch(batch);
	node_send_batch(batch);
	estimator_take(batch);
}

void node_send_batch(const struct wire_imu_batch *batch)
{
	uint8_t payload[WIRE_IMU_BATCH_MAX_SIZE];

	CHECK(wire_imu_batch_put(payload, batch) != 0U);
}

int link_send(uint8_t type, const uint8_t *payload, size_t len)
{
	(void)type;
	(void)payload;
	CHECK(len <= WIRE_MAX_PAYLOAD_SIZE);
	return 0;
}

void diag_uart_frame(uint8_t type, const uint8_t *payload, size_t len)
{
	(void)link_send(type, payload, len);
}

void diag_report_fill_hello(struct wire_hello *hello)
{
	memset(hello, 0, sizeof(*hello));
}

void diag_report_fault(uint16_t code, uint32_t argument, const char *detail)
{
	(void)code;
	(void)argument;
	(void)detail;
}

void diag_csv_imu(const struct wire_imu_batch *batch)
{
	(void)batch;
}

void diag_csv_sync(const struct wire_sync_state *state)
{
	(void)state;
}

void node_send_sync_state(const struct wire_sync_state *state)
{
	(void)state;
}

void node_send_sync_capture(const struct wire_sync_capture *capture)
{
	(void)capture;
}

void sync_ppi_connection_begin(uint16_t handle, bool central)
{
	(void)handle;
	(void)central;
}

void sync_ppi_connection_end(void)
{
}

_Noreturn void node_run(const struct node_config *config)
{
	(void)config;
	abort();
}

/* ---- Steps --------------------------------------------------------------------------------- */

/* As link_receive() hands it on, from a buffer that is exactly as long. */
static void receive(bool leader, const uint8_t *value, size_t len)
{
	uint8_t *exact;

	if (len < 1U) {
		return;
	}
	exact = malloc(len);
	CHECK(exact != NULL);
	memcpy(exact, value, len);
	(void)(leader ? leader_receive : follower_receive)(exact[0], exact + 1, len - 1U);
	free(exact);
}

static void step_hostile(struct input *in, bool leader)
{
	size_t len = next(in, 1);

	len = len < in->left ? len : in->left;
	receive(leader, in->bytes, len);
	in->bytes += len;
	in->left -= len;
}

/* Exchanges of a peer whose clock is ahead by some, and runs faster by up to 127 ppm. */
static void step_pairs(struct input *in)
{
	uint32_t count = next(in, 1) % 200U;
	uint64_t offset = (uint64_t)next(in, 4) << 12;
	int32_t ppm = (int8_t)next(in, 1);
	uint32_t noise = next(in, 1);

	for (uint32_t i = 0; i < count; i++) {
		struct wire_sync_capture message = {.event = event};
		struct sync_capture own = {.event = event};
		uint8_t value[1U + WIRE_SYNC_CAPTURE_SIZE] = {WIRE_SYNC_CAPTURE_ID};
		int64_t drift = (int64_t)(now_ticks / 1000000U) * ppm;

		now_ticks += EVENT_TICKS;
		own.tx_end_ticks = now_ticks - 20000U;
		own.rx_end_ticks = own.tx_end_ticks + 5000U + 2U * FLIGHT_TICKS;
		message.tx_end_ticks_node = own.rx_end_ticks - FLIGHT_TICKS + offset + (uint64_t)drift;
		message.rx_end_ticks_node = own.tx_end_ticks + FLIGHT_TICKS + offset +
					    (uint64_t)drift + (noise & i & 3U);
		leader_capture(&own);
		(void)wire_sync_capture_put(value + 1, &message);
		receive(true, value, sizeof(value));
		/* Before the queue of captures is full. */
		if (i % 16U == 15U) {
			leader_threads();
		}
		event++;
	}
	leader_threads();
}

/* The leader's own sensor at rest. */
static void step_own(struct input *in)
{
	uint32_t count = next(in, 1);

	for (; count > 0U && batches_left > 0U; count--, batches_left--) {
		struct wire_imu_batch batch = {
			.accel_fs_g = 16,
			.gyro_fs_dps = 2000,
			.sample_index = leader_index,
			.period_ticks = PERIOD,
			.t_first_ticks_node = now_ticks - 10U * (PERIOD >> 8),
			.count = 8,
		};

		for (uint32_t i = 0; i < batch.count; i++) {
			batch.samples[i].accel_lsb[2] = (int16_t)(2048 + (int)(i & 1U));
		}
		leader_index += batch.count;
		now_ticks += batch.count * (PERIOD >> 8);
		leader_batch(&batch);
	}
}

/* A sound batch of the follower, with some bytes that are not. */
static void step_batch(struct input *in)
{
	struct wire_imu_batch batch = {
		.source = WIRE_ROLE_FOLLOWER,
		.accel_fs_g = 16,
		.gyro_fs_dps = 2000,
		.sample_index = next(in, 2),
		.period_ticks = PERIOD,
		.count = 8,
	};
	uint8_t value[1U + WIRE_IMU_BATCH_MAX_SIZE] = {WIRE_IMU_BATCH_ID};
	uint64_t offset = (uint64_t)next(in, 4) << 12;
	uint32_t wrong = next(in, 1) % 16U;
	size_t size;

	batch.t_first_ticks_node = now_ticks + offset - 10U * (PERIOD >> 8);
	size = 1U + wire_imu_batch_put(value + 1, &batch);
	for (; wrong > 0U; wrong--) {
		/* Nearly all of what can be wrong stands in front of the samples. */
		size_t at = 1U + next(in, 1) % 40U;

		value[at] = (uint8_t)next(in, 1);
	}
	receive(true, value, size);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct input in = {data, size};

	now_ticks = (uint64_t)16000000U * 1000U;
	event = 0;
	leader_index = 0;
	batches_left = BATCHES_MAX;
	leader_reset();
	follower_reset();
	estimator_reset();
	leader_connect();
	follower_connect();
	for (int steps = 0; steps < STEPS_MAX && in.left > 0U; steps++) {
		switch (next(&in, 1) % 8U) {
		case 0:
			step_hostile(&in, true);
			break;
		case 1:
			step_hostile(&in, false);
			break;
		case 2:
			step_pairs(&in);
			break;
		case 3:
			step_own(&in);
			break;
		case 4:
			step_batch(&in);
			break;
		case 5:
			now_ticks += next(&in, 4);
			leader_threads();
			break;
		case 6:
			follower_convert(now_ticks + next(&in, 4));
			break;
		default:
			event = 0;
			leader_connect();
			follower_connect();
			break;
		}
	}
	return 0;
}
