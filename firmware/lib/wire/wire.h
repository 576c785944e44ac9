/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Generated from hil/wire/messages.py by `python -m hil.wire.cgen`; edit the table, not this file.
 *
 * Payloads are little-endian and unaligned. Every access goes byte by byte through the functions
 * below: no packed structures, no casts of buffers. Members hold raw counts; the physical value is
 * raw * scale, where a scale other than 1 is WIRE_<MESSAGE>_<FIELD>_SCALE.
 *
 * size_t wire_<message>_put(buf, m)       writes the payload, returns its size; buf must hold
 *                                         _SIZE (or _MAX_SIZE) bytes; 0 when a count is too large
 * bool   wire_<message>_get(m, buf, len)  false when len does not fit the message or a count is too
 *                                         large; rows beyond the count are left as they were
 */
#ifndef WIRE_H_
#define WIRE_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define WIRE_PROTOCOL_VERSION 1u
#define WIRE_SCHEMA_HASH UINT64_C(0x77192D048B87FC0A)
#define WIRE_TICK_RATE_HZ 16000000u
/* Size of the largest payload of all messages. */
#define WIRE_MAX_PAYLOAD_SIZE 218u

enum {
	WIRE_ROLE_LEADER = 0,
	WIRE_ROLE_FOLLOWER = 1,
};

enum {
	WIRE_TARGET_SIM = 0,
	WIRE_TARGET_NRF52840DK = 1,
};

enum {
	WIRE_SYNC_STATE_UNSYNCED = 0,
	WIRE_SYNC_STATE_CONVERGING = 1,
	WIRE_SYNC_STATE_LOCKED = 2,
	WIRE_SYNC_STATE_HOLDOVER = 3,
};

enum {
	WIRE_PULSE_FLAG_LATE = 1,
	WIRE_PULSE_FLAG_CAPTURED = 2,
};

enum {
	WIRE_IMU_FLAG_HARDWARE_TIME = 1,
	WIRE_IMU_FLAG_OVERRUN_BEFORE = 2,
	WIRE_IMU_FLAG_CLIPPED = 4,
	WIRE_IMU_FLAG_UNCORRECTED = 8,
};

enum {
	WIRE_FAULT_CODE_ASSERT = 1,
	WIRE_FAULT_CODE_WATCHDOG = 2,
	WIRE_FAULT_CODE_STACK = 3,
	WIRE_FAULT_CODE_IMU_WHO_AM_I = 16,
	WIRE_FAULT_CODE_IMU_BUS = 17,
	WIRE_FAULT_CODE_IMU_NO_INTERRUPT = 18,
	WIRE_FAULT_CODE_IMU_FIFO_CONFIG = 19,
	WIRE_FAULT_CODE_LINK_BAD_PAYLOAD = 32,
	WIRE_FAULT_CODE_PPI_EXHAUSTED = 33,
	WIRE_FAULT_CODE_COMMAND_REFUSED = 34,
	WIRE_FAULT_CODE_FUSION_OVERRUN = 35,
	WIRE_FAULT_CODE_LINK_STRANGER = 36,
	WIRE_FAULT_CODE_CAL_BIAS_REFUSED = 48,
	WIRE_FAULT_CODE_CAL_STORE = 49,
};

enum {
	WIRE_CAL_ORIGIN_DEFAULTS = 0,
	WIRE_CAL_ORIGIN_STORED = 1,
};

enum {
	WIRE_CAL_REASON_NONE = 0,
	WIRE_CAL_REASON_ABSENT = 1,
	WIRE_CAL_REASON_CORRUPT = 2,
	WIRE_CAL_REASON_VERSION = 3,
	WIRE_CAL_REASON_OTHER_DEVICE = 4,
	WIRE_CAL_REASON_FLASH = 5,
};

enum {
	WIRE_BOOT_CHECK_PENDING = 0,
	WIRE_BOOT_CHECK_APPLIED = 1,
	WIRE_BOOT_CHECK_WARNED = 2,
	WIRE_BOOT_CHECK_REFUSED = 3,
	WIRE_BOOT_CHECK_MOVING = 4,
};

enum {
	WIRE_NODE_COMMAND_CAL_READ = 1,
	WIRE_NODE_COMMAND_CAL_ERASE = 2,
	WIRE_NODE_COMMAND_RAW_ON = 3,
	WIRE_NODE_COMMAND_RAW_OFF = 4,
	WIRE_NODE_COMMAND_REBOOT = 5,
	WIRE_NODE_COMMAND_FAIL_FATAL = 240,
	WIRE_NODE_COMMAND_FAIL_STACK = 241,
	WIRE_NODE_COMMAND_FAIL_HANG = 242,
};

enum {
	WIRE_LINK_KEY_ORIGIN_IMAGE = 0,
	WIRE_LINK_KEY_ORIGIN_STORED = 1,
};

enum {
	WIRE_REP_KIND_NONE = 0,
	WIRE_REP_KIND_FULL = 1,
	WIRE_REP_KIND_PARTIAL = 2,
};

enum {
	WIRE_REP_FLAG_CORRECTION = 1,
	WIRE_REP_FLAG_LOWERED = 2,
	WIRE_REP_FLAG_PAUSED = 4,
	WIRE_REP_FLAG_FROM_FLOOR = 8,
	WIRE_REP_FLAG_FOLLOWER_LOST = 16,
	WIRE_REP_FLAG_CLIPPED = 32,
};

static inline void wire_put_u8(uint8_t *buf, uint8_t value)
{
	buf[0] = value;
}

static inline void wire_put_u16(uint8_t *buf, uint16_t value)
{
	buf[0] = (uint8_t)(value & 0xFFu);
	buf[1] = (uint8_t)(value >> 8);
}

static inline void wire_put_u32(uint8_t *buf, uint32_t value)
{
	wire_put_u16(buf, (uint16_t)(value & 0xFFFFu));
	wire_put_u16(buf + 2, (uint16_t)(value >> 16));
}

static inline void wire_put_u64(uint8_t *buf, uint64_t value)
{
	wire_put_u32(buf, (uint32_t)(value & 0xFFFFFFFFu));
	wire_put_u32(buf + 4, (uint32_t)(value >> 32));
}

static inline void wire_put_i8(uint8_t *buf, int8_t value)
{
	wire_put_u8(buf, (uint8_t)value);
}

static inline void wire_put_i16(uint8_t *buf, int16_t value)
{
	wire_put_u16(buf, (uint16_t)value);
}

static inline void wire_put_i32(uint8_t *buf, int32_t value)
{
	wire_put_u32(buf, (uint32_t)value);
}

static inline void wire_put_i64(uint8_t *buf, int64_t value)
{
	wire_put_u64(buf, (uint64_t)value);
}

static inline void wire_put_f32(uint8_t *buf, float value)
{
	uint32_t bits;

	memcpy(&bits, &value, sizeof(bits));
	wire_put_u32(buf, bits);
}

static inline uint8_t wire_get_u8(const uint8_t *buf)
{
	return buf[0];
}

static inline uint16_t wire_get_u16(const uint8_t *buf)
{
	return (uint16_t)(buf[0] | ((uint32_t)buf[1] << 8));
}

static inline uint32_t wire_get_u32(const uint8_t *buf)
{
	return wire_get_u16(buf) | ((uint32_t)wire_get_u16(buf + 2) << 16);
}

static inline uint64_t wire_get_u64(const uint8_t *buf)
{
	return wire_get_u32(buf) | ((uint64_t)wire_get_u32(buf + 4) << 32);
}

static inline int8_t wire_get_i8(const uint8_t *buf)
{
	return (int8_t)wire_get_u8(buf);
}

static inline int16_t wire_get_i16(const uint8_t *buf)
{
	return (int16_t)wire_get_u16(buf);
}

static inline int32_t wire_get_i32(const uint8_t *buf)
{
	return (int32_t)wire_get_u32(buf);
}

static inline int64_t wire_get_i64(const uint8_t *buf)
{
	return (int64_t)wire_get_u64(buf);
}

static inline float wire_get_f32(const uint8_t *buf)
{
	uint32_t bits = wire_get_u32(buf);
	float value;

	memcpy(&value, &bits, sizeof(value));
	return value;
}

/* Who is speaking: sent at boot and every two seconds. */
#define WIRE_HELLO_ID 1u
#define WIRE_HELLO_SIZE 43u
#define WIRE_HELLO_PROTOCOL_VERSION_OFFSET 0u
#define WIRE_HELLO_ROLE_OFFSET 1u
#define WIRE_HELLO_TARGET_OFFSET 2u
#define WIRE_HELLO_SCHEMA_HASH_OFFSET 3u
#define WIRE_HELLO_BUILD_ID_OFFSET 11u
#define WIRE_HELLO_DEVICE_ID_OFFSET 19u
#define WIRE_HELLO_RESET_REASON_OFFSET 27u
#define WIRE_HELLO_TICK_RATE_HZ_OFFSET 31u
#define WIRE_HELLO_CONN_INTERVAL_US_OFFSET 35u
#define WIRE_HELLO_UPTIME_MS_OFFSET 39u

struct wire_hello {
	/* Version of the framing. [1] */
	uint8_t protocol_version;
	/* 0 leader, 1 follower. [1] */
	uint8_t role;
	/* 0 simulated radio, 1 nRF52840 DK. [1] */
	uint8_t target;
	/* First eight bytes of the SHA-256 of the table. [1] */
	uint64_t schema_hash;
	/* Build identity given by the build orchestrator. [1] */
	uint64_t build_id;
	/* FICR DEVICEID of the chip. [1] */
	uint64_t device_id;
	/* POWER RESETREAS as found at boot. [1] */
	uint32_t reset_reason;
	/* Rate of the node's timestamp TIMER. [Hz] */
	uint32_t tick_rate_hz;
	/* Connection interval asked for. [us] */
	uint32_t conn_interval_us;
	/* Time since boot on the kernel's clock. [ms] */
	uint32_t uptime_ms;
};

static inline size_t wire_hello_put(uint8_t *buf, const struct wire_hello *m)
{
	wire_put_u8(buf + WIRE_HELLO_PROTOCOL_VERSION_OFFSET, m->protocol_version);
	wire_put_u8(buf + WIRE_HELLO_ROLE_OFFSET, m->role);
	wire_put_u8(buf + WIRE_HELLO_TARGET_OFFSET, m->target);
	wire_put_u64(buf + WIRE_HELLO_SCHEMA_HASH_OFFSET, m->schema_hash);
	wire_put_u64(buf + WIRE_HELLO_BUILD_ID_OFFSET, m->build_id);
	wire_put_u64(buf + WIRE_HELLO_DEVICE_ID_OFFSET, m->device_id);
	wire_put_u32(buf + WIRE_HELLO_RESET_REASON_OFFSET, m->reset_reason);
	wire_put_u32(buf + WIRE_HELLO_TICK_RATE_HZ_OFFSET, m->tick_rate_hz);
	wire_put_u32(buf + WIRE_HELLO_CONN_INTERVAL_US_OFFSET, m->conn_interval_us);
	wire_put_u32(buf + WIRE_HELLO_UPTIME_MS_OFFSET, m->uptime_ms);
	return WIRE_HELLO_SIZE;
}

static inline bool wire_hello_get(struct wire_hello *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_HELLO_SIZE) {
		return false;
	}
	m->protocol_version = wire_get_u8(buf + WIRE_HELLO_PROTOCOL_VERSION_OFFSET);
	m->role = wire_get_u8(buf + WIRE_HELLO_ROLE_OFFSET);
	m->target = wire_get_u8(buf + WIRE_HELLO_TARGET_OFFSET);
	m->schema_hash = wire_get_u64(buf + WIRE_HELLO_SCHEMA_HASH_OFFSET);
	m->build_id = wire_get_u64(buf + WIRE_HELLO_BUILD_ID_OFFSET);
	m->device_id = wire_get_u64(buf + WIRE_HELLO_DEVICE_ID_OFFSET);
	m->reset_reason = wire_get_u32(buf + WIRE_HELLO_RESET_REASON_OFFSET);
	m->tick_rate_hz = wire_get_u32(buf + WIRE_HELLO_TICK_RATE_HZ_OFFSET);
	m->conn_interval_us = wire_get_u32(buf + WIRE_HELLO_CONN_INTERVAL_US_OFFSET);
	m->uptime_ms = wire_get_u32(buf + WIRE_HELLO_UPTIME_MS_OFFSET);
	return true;
}

/* Consecutive samples of one IMU with the hardware time of the first. */
#define WIRE_IMU_BATCH_ID 2u
#define WIRE_IMU_BATCH_SIZE 26u
#define WIRE_IMU_BATCH_MAX_COUNT 16u
#define WIRE_IMU_BATCH_MAX_SIZE 218u
#define WIRE_IMU_BATCH_SOURCE_OFFSET 0u
#define WIRE_IMU_BATCH_FLAGS_OFFSET 1u
#define WIRE_IMU_BATCH_ACCEL_FS_G_OFFSET 2u
#define WIRE_IMU_BATCH_GYRO_FS_DPS_OFFSET 3u
#define WIRE_IMU_BATCH_SAMPLE_INDEX_OFFSET 5u
#define WIRE_IMU_BATCH_T_FIRST_TICKS_NODE_OFFSET 9u
#define WIRE_IMU_BATCH_PERIOD_TICKS_OFFSET 17u
#define WIRE_IMU_BATCH_PERIOD_TICKS_SCALE 0.00390625
#define WIRE_IMU_BATCH_T_SIGMA_TICKS_OFFSET 21u
#define WIRE_IMU_BATCH_T_SIGMA_TICKS_SCALE 0.00390625
#define WIRE_IMU_BATCH_TEMPERATURE_CDEGC_OFFSET 23u
#define WIRE_IMU_BATCH_TEMPERATURE_CDEGC_SCALE 0.01
#define WIRE_IMU_BATCH_COUNT_OFFSET 25u
#define WIRE_IMU_BATCH_SAMPLES_SIZE 12u
#define WIRE_IMU_BATCH_SAMPLES_GYRO_LSB_OFFSET 0u
#define WIRE_IMU_BATCH_SAMPLES_GYRO_LSB_COUNT 3u
#define WIRE_IMU_BATCH_SAMPLES_ACCEL_LSB_OFFSET 6u
#define WIRE_IMU_BATCH_SAMPLES_ACCEL_LSB_COUNT 3u

struct wire_imu_batch_samples {
	/* Angular rate, raw counts, x y z. [LSB] */
	int16_t gyro_lsb[3];
	/* Specific force, raw counts, x y z. [LSB] */
	int16_t accel_lsb[3];
};

struct wire_imu_batch {
	/* Whose IMU: 0 leader, 1 follower. [1] */
	uint8_t source;
	/* Bits of IMU_FLAGS. [1] */
	uint8_t flags;
	/* Accelerometer full scale. [g] */
	uint8_t accel_fs_g;
	/* Gyroscope full scale. [dps] */
	uint16_t gyro_fs_dps;
	/* Index of the first sample since the IMU started. [1] */
	uint32_t sample_index;
	/* Time of the first sample. [tick, node clock] */
	uint64_t t_first_ticks_node;
	/* Measured sample period. [0.00390625 tick, node clock] */
	uint32_t period_ticks;
	/* Standard error of the first sample's time; 65535: that or more. [0.00390625 tick] */
	uint16_t t_sigma_ticks;
	/* Die temperature. [0.01 degC] */
	int16_t temperature_cdegc;
	/* Samples that follow. [1] */
	uint8_t count;
	struct wire_imu_batch_samples samples[WIRE_IMU_BATCH_MAX_COUNT];
};

static inline size_t wire_imu_batch_put(uint8_t *buf, const struct wire_imu_batch *m)
{
	if (m->count > WIRE_IMU_BATCH_MAX_COUNT) {
		return 0;
	}
	wire_put_u8(buf + WIRE_IMU_BATCH_SOURCE_OFFSET, m->source);
	wire_put_u8(buf + WIRE_IMU_BATCH_FLAGS_OFFSET, m->flags);
	wire_put_u8(buf + WIRE_IMU_BATCH_ACCEL_FS_G_OFFSET, m->accel_fs_g);
	wire_put_u16(buf + WIRE_IMU_BATCH_GYRO_FS_DPS_OFFSET, m->gyro_fs_dps);
	wire_put_u32(buf + WIRE_IMU_BATCH_SAMPLE_INDEX_OFFSET, m->sample_index);
	wire_put_u64(buf + WIRE_IMU_BATCH_T_FIRST_TICKS_NODE_OFFSET, m->t_first_ticks_node);
	wire_put_u32(buf + WIRE_IMU_BATCH_PERIOD_TICKS_OFFSET, m->period_ticks);
	wire_put_u16(buf + WIRE_IMU_BATCH_T_SIGMA_TICKS_OFFSET, m->t_sigma_ticks);
	wire_put_i16(buf + WIRE_IMU_BATCH_TEMPERATURE_CDEGC_OFFSET, m->temperature_cdegc);
	wire_put_u8(buf + WIRE_IMU_BATCH_COUNT_OFFSET, m->count);
	for (size_t r = 0; r < m->count; r++) {
		uint8_t *row = buf + WIRE_IMU_BATCH_SIZE + r * WIRE_IMU_BATCH_SAMPLES_SIZE;

		for (size_t i = 0; i < WIRE_IMU_BATCH_SAMPLES_GYRO_LSB_COUNT; i++) {
			wire_put_i16(row + WIRE_IMU_BATCH_SAMPLES_GYRO_LSB_OFFSET + 2u * i,
			    m->samples[r].gyro_lsb[i]);
		}
		for (size_t i = 0; i < WIRE_IMU_BATCH_SAMPLES_ACCEL_LSB_COUNT; i++) {
			wire_put_i16(row + WIRE_IMU_BATCH_SAMPLES_ACCEL_LSB_OFFSET + 2u * i,
			    m->samples[r].accel_lsb[i]);
		}
	}
	return WIRE_IMU_BATCH_SIZE + (size_t)m->count * WIRE_IMU_BATCH_SAMPLES_SIZE;
}

static inline bool wire_imu_batch_get(struct wire_imu_batch *m, const uint8_t *buf,
					size_t len)
{
	if (len < WIRE_IMU_BATCH_SIZE) {
		return false;
	}
	m->source = wire_get_u8(buf + WIRE_IMU_BATCH_SOURCE_OFFSET);
	m->flags = wire_get_u8(buf + WIRE_IMU_BATCH_FLAGS_OFFSET);
	m->accel_fs_g = wire_get_u8(buf + WIRE_IMU_BATCH_ACCEL_FS_G_OFFSET);
	m->gyro_fs_dps = wire_get_u16(buf + WIRE_IMU_BATCH_GYRO_FS_DPS_OFFSET);
	m->sample_index = wire_get_u32(buf + WIRE_IMU_BATCH_SAMPLE_INDEX_OFFSET);
	m->t_first_ticks_node = wire_get_u64(buf + WIRE_IMU_BATCH_T_FIRST_TICKS_NODE_OFFSET);
	m->period_ticks = wire_get_u32(buf + WIRE_IMU_BATCH_PERIOD_TICKS_OFFSET);
	m->t_sigma_ticks = wire_get_u16(buf + WIRE_IMU_BATCH_T_SIGMA_TICKS_OFFSET);
	m->temperature_cdegc = wire_get_i16(buf + WIRE_IMU_BATCH_TEMPERATURE_CDEGC_OFFSET);
	m->count = wire_get_u8(buf + WIRE_IMU_BATCH_COUNT_OFFSET);
	if (m->count > WIRE_IMU_BATCH_MAX_COUNT ||
	    len != WIRE_IMU_BATCH_SIZE + (size_t)m->count * WIRE_IMU_BATCH_SAMPLES_SIZE) {
		return false;
	}
	for (size_t r = 0; r < m->count; r++) {
		const uint8_t *row = buf + WIRE_IMU_BATCH_SIZE + r * WIRE_IMU_BATCH_SAMPLES_SIZE;

		for (size_t i = 0; i < WIRE_IMU_BATCH_SAMPLES_GYRO_LSB_COUNT; i++) {
			m->samples[r].gyro_lsb[i] =
			    wire_get_i16(row + WIRE_IMU_BATCH_SAMPLES_GYRO_LSB_OFFSET + 2u * i);
		}
		for (size_t i = 0; i < WIRE_IMU_BATCH_SAMPLES_ACCEL_LSB_COUNT; i++) {
			m->samples[r].accel_lsb[i] =
			    wire_get_i16(row + WIRE_IMU_BATCH_SAMPLES_ACCEL_LSB_OFFSET + 2u * i);
		}
	}
	return true;
}

/* This node's own captures of one connection event: end of its TX and of its RX. */
#define WIRE_SYNC_CAPTURE_ID 3u
#define WIRE_SYNC_CAPTURE_SIZE 21u
#define WIRE_SYNC_CAPTURE_EVENT_OFFSET 0u
#define WIRE_SYNC_CAPTURE_GENERATION_OFFSET 4u
#define WIRE_SYNC_CAPTURE_TX_END_TICKS_NODE_OFFSET 5u
#define WIRE_SYNC_CAPTURE_RX_END_TICKS_NODE_OFFSET 13u

struct wire_sync_capture {
	/* Connection event counter, extended to 32 bit. [1] */
	uint32_t event;
	/* Counts connections since boot. [1] */
	uint8_t generation;
	/* RADIO END of the first TX. [tick, node clock] */
	uint64_t tx_end_ticks_node;
	/* RADIO END of the first RX. [tick, node clock] */
	uint64_t rx_end_ticks_node;
};

static inline size_t wire_sync_capture_put(uint8_t *buf, const struct wire_sync_capture *m)
{
	wire_put_u32(buf + WIRE_SYNC_CAPTURE_EVENT_OFFSET, m->event);
	wire_put_u8(buf + WIRE_SYNC_CAPTURE_GENERATION_OFFSET, m->generation);
	wire_put_u64(buf + WIRE_SYNC_CAPTURE_TX_END_TICKS_NODE_OFFSET, m->tx_end_ticks_node);
	wire_put_u64(buf + WIRE_SYNC_CAPTURE_RX_END_TICKS_NODE_OFFSET, m->rx_end_ticks_node);
	return WIRE_SYNC_CAPTURE_SIZE;
}

static inline bool wire_sync_capture_get(struct wire_sync_capture *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_SYNC_CAPTURE_SIZE) {
		return false;
	}
	m->event = wire_get_u32(buf + WIRE_SYNC_CAPTURE_EVENT_OFFSET);
	m->generation = wire_get_u8(buf + WIRE_SYNC_CAPTURE_GENERATION_OFFSET);
	m->tx_end_ticks_node = wire_get_u64(buf + WIRE_SYNC_CAPTURE_TX_END_TICKS_NODE_OFFSET);
	m->rx_end_ticks_node = wire_get_u64(buf + WIRE_SYNC_CAPTURE_RX_END_TICKS_NODE_OFFSET);
	return true;
}

/* The leader's pairing of both nodes' captures of one connection event. */
#define WIRE_SYNC_PAIR_ID 4u
#define WIRE_SYNC_PAIR_SIZE 38u
#define WIRE_SYNC_PAIR_EVENT_OFFSET 0u
#define WIRE_SYNC_PAIR_GENERATION_OFFSET 4u
#define WIRE_SYNC_PAIR_FLAGS_OFFSET 5u
#define WIRE_SYNC_PAIR_TX_END_TICKS_LEADER_OFFSET 6u
#define WIRE_SYNC_PAIR_RX_END_TICKS_LEADER_OFFSET 14u
#define WIRE_SYNC_PAIR_TX_END_TICKS_FOLLOWER_OFFSET 22u
#define WIRE_SYNC_PAIR_RX_END_TICKS_FOLLOWER_OFFSET 30u

struct wire_sync_pair {
	/* Connection event counter, extended to 32 bit. [1] */
	uint32_t event;
	/* Counts connections since boot. [1] */
	uint8_t generation;
	/* 1: used in the estimate; 0: dropped as an outlier. [1] */
	uint8_t flags;
	/* Leader TX end. [tick, leader clock] */
	uint64_t tx_end_ticks_leader;
	/* Leader RX end. [tick, leader clock] */
	uint64_t rx_end_ticks_leader;
	/* Follower TX end. [tick, follower clock] */
	uint64_t tx_end_ticks_follower;
	/* Follower RX end. [tick, follower clock] */
	uint64_t rx_end_ticks_follower;
};

static inline size_t wire_sync_pair_put(uint8_t *buf, const struct wire_sync_pair *m)
{
	wire_put_u32(buf + WIRE_SYNC_PAIR_EVENT_OFFSET, m->event);
	wire_put_u8(buf + WIRE_SYNC_PAIR_GENERATION_OFFSET, m->generation);
	wire_put_u8(buf + WIRE_SYNC_PAIR_FLAGS_OFFSET, m->flags);
	wire_put_u64(buf + WIRE_SYNC_PAIR_TX_END_TICKS_LEADER_OFFSET, m->tx_end_ticks_leader);
	wire_put_u64(buf + WIRE_SYNC_PAIR_RX_END_TICKS_LEADER_OFFSET, m->rx_end_ticks_leader);
	wire_put_u64(buf + WIRE_SYNC_PAIR_TX_END_TICKS_FOLLOWER_OFFSET, m->tx_end_ticks_follower);
	wire_put_u64(buf + WIRE_SYNC_PAIR_RX_END_TICKS_FOLLOWER_OFFSET, m->rx_end_ticks_follower);
	return WIRE_SYNC_PAIR_SIZE;
}

static inline bool wire_sync_pair_get(struct wire_sync_pair *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_SYNC_PAIR_SIZE) {
		return false;
	}
	m->event = wire_get_u32(buf + WIRE_SYNC_PAIR_EVENT_OFFSET);
	m->generation = wire_get_u8(buf + WIRE_SYNC_PAIR_GENERATION_OFFSET);
	m->flags = wire_get_u8(buf + WIRE_SYNC_PAIR_FLAGS_OFFSET);
	m->tx_end_ticks_leader = wire_get_u64(buf + WIRE_SYNC_PAIR_TX_END_TICKS_LEADER_OFFSET);
	m->rx_end_ticks_leader = wire_get_u64(buf + WIRE_SYNC_PAIR_RX_END_TICKS_LEADER_OFFSET);
	m->tx_end_ticks_follower = wire_get_u64(buf + WIRE_SYNC_PAIR_TX_END_TICKS_FOLLOWER_OFFSET);
	m->rx_end_ticks_follower = wire_get_u64(buf + WIRE_SYNC_PAIR_RX_END_TICKS_FOLLOWER_OFFSET);
	return true;
}

/* Clock model: follower = leader + offset + skew * (leader - t_ref). */
#define WIRE_SYNC_STATE_ID 5u
#define WIRE_SYNC_STATE_SIZE 40u
#define WIRE_SYNC_STATE_T_REF_TICKS_LEADER_OFFSET 0u
#define WIRE_SYNC_STATE_OFFSET_TICKS_OFFSET 8u
#define WIRE_SYNC_STATE_OFFSET_TICKS_SCALE 0.00390625
#define WIRE_SYNC_STATE_SKEW_OFFSET 16u
#define WIRE_SYNC_STATE_SKEW_SCALE 1e-12
#define WIRE_SYNC_STATE_RESIDUAL_RMS_TICKS_OFFSET 20u
#define WIRE_SYNC_STATE_RESIDUAL_RMS_TICKS_SCALE 0.00390625
#define WIRE_SYNC_STATE_OFFSET_SIGMA_TICKS_OFFSET 24u
#define WIRE_SYNC_STATE_OFFSET_SIGMA_TICKS_SCALE 0.00390625
#define WIRE_SYNC_STATE_WINDOW_US_OFFSET 28u
#define WIRE_SYNC_STATE_PAIRS_USED_OFFSET 32u
#define WIRE_SYNC_STATE_PAIRS_DROPPED_OFFSET 34u
#define WIRE_SYNC_STATE_STATE_OFFSET 38u
#define WIRE_SYNC_STATE_GENERATION_OFFSET 39u

struct wire_sync_state {
	/* Reference instant. [tick, leader clock] */
	uint64_t t_ref_ticks_leader;
	/* Follower minus leader at the reference instant. [0.00390625 tick] */
	int64_t offset_ticks;
	/* Follower rate over leader rate, minus one. [1e-12 1] */
	int32_t skew;
	/* RMS of the fit's residuals. [0.00390625 tick] */
	uint32_t residual_rms_ticks;
	/* Standard error of offset. [0.00390625 tick] */
	uint32_t offset_sigma_ticks;
	/* Length of the window of pairs. [us] */
	uint32_t window_us;
	/* Pairs in the window. [1] */
	uint16_t pairs_used;
	/* Pairs rejected since boot. [1] */
	uint32_t pairs_dropped;
	/* A value of SYNC_STATES. [1] */
	uint8_t state;
	/* Counts connections since boot. [1] */
	uint8_t generation;
};

static inline size_t wire_sync_state_put(uint8_t *buf, const struct wire_sync_state *m)
{
	wire_put_u64(buf + WIRE_SYNC_STATE_T_REF_TICKS_LEADER_OFFSET, m->t_ref_ticks_leader);
	wire_put_i64(buf + WIRE_SYNC_STATE_OFFSET_TICKS_OFFSET, m->offset_ticks);
	wire_put_i32(buf + WIRE_SYNC_STATE_SKEW_OFFSET, m->skew);
	wire_put_u32(buf + WIRE_SYNC_STATE_RESIDUAL_RMS_TICKS_OFFSET, m->residual_rms_ticks);
	wire_put_u32(buf + WIRE_SYNC_STATE_OFFSET_SIGMA_TICKS_OFFSET, m->offset_sigma_ticks);
	wire_put_u32(buf + WIRE_SYNC_STATE_WINDOW_US_OFFSET, m->window_us);
	wire_put_u16(buf + WIRE_SYNC_STATE_PAIRS_USED_OFFSET, m->pairs_used);
	wire_put_u32(buf + WIRE_SYNC_STATE_PAIRS_DROPPED_OFFSET, m->pairs_dropped);
	wire_put_u8(buf + WIRE_SYNC_STATE_STATE_OFFSET, m->state);
	wire_put_u8(buf + WIRE_SYNC_STATE_GENERATION_OFFSET, m->generation);
	return WIRE_SYNC_STATE_SIZE;
}

static inline bool wire_sync_state_get(struct wire_sync_state *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_SYNC_STATE_SIZE) {
		return false;
	}
	m->t_ref_ticks_leader = wire_get_u64(buf + WIRE_SYNC_STATE_T_REF_TICKS_LEADER_OFFSET);
	m->offset_ticks = wire_get_i64(buf + WIRE_SYNC_STATE_OFFSET_TICKS_OFFSET);
	m->skew = wire_get_i32(buf + WIRE_SYNC_STATE_SKEW_OFFSET);
	m->residual_rms_ticks = wire_get_u32(buf + WIRE_SYNC_STATE_RESIDUAL_RMS_TICKS_OFFSET);
	m->offset_sigma_ticks = wire_get_u32(buf + WIRE_SYNC_STATE_OFFSET_SIGMA_TICKS_OFFSET);
	m->window_us = wire_get_u32(buf + WIRE_SYNC_STATE_WINDOW_US_OFFSET);
	m->pairs_used = wire_get_u16(buf + WIRE_SYNC_STATE_PAIRS_USED_OFFSET);
	m->pairs_dropped = wire_get_u32(buf + WIRE_SYNC_STATE_PAIRS_DROPPED_OFFSET);
	m->state = wire_get_u8(buf + WIRE_SYNC_STATE_STATE_OFFSET);
	m->generation = wire_get_u8(buf + WIRE_SYNC_STATE_GENERATION_OFFSET);
	return true;
}

/* A pulse emitted by TIMER COMPARE -> GPIOTE at an instant of the leader's clock. */
#define WIRE_PULSE_ID 6u
#define WIRE_PULSE_SIZE 29u
#define WIRE_PULSE_INDEX_OFFSET 0u
#define WIRE_PULSE_SCHEDULED_TICKS_LEADER_OFFSET 4u
#define WIRE_PULSE_COMPARE_TICKS_NODE_OFFSET 12u
#define WIRE_PULSE_CAPTURED_TICKS_NODE_OFFSET 20u
#define WIRE_PULSE_FLAGS_OFFSET 28u

struct wire_pulse {
	/* Pulse number on the leader's schedule; equal on both. [1] */
	uint32_t index;
	/* Agreed instant. [tick, leader clock] */
	uint64_t scheduled_ticks_leader;
	/* Programmed COMPARE. [tick, node clock] */
	uint64_t compare_ticks_node;
	/* Capture of the other node's pulse when wired; 0 when not. [tick, node clock] */
	uint64_t captured_ticks_node;
	/* Bits of PULSE_FLAGS. [1] */
	uint8_t flags;
};

static inline size_t wire_pulse_put(uint8_t *buf, const struct wire_pulse *m)
{
	wire_put_u32(buf + WIRE_PULSE_INDEX_OFFSET, m->index);
	wire_put_u64(buf + WIRE_PULSE_SCHEDULED_TICKS_LEADER_OFFSET, m->scheduled_ticks_leader);
	wire_put_u64(buf + WIRE_PULSE_COMPARE_TICKS_NODE_OFFSET, m->compare_ticks_node);
	wire_put_u64(buf + WIRE_PULSE_CAPTURED_TICKS_NODE_OFFSET, m->captured_ticks_node);
	wire_put_u8(buf + WIRE_PULSE_FLAGS_OFFSET, m->flags);
	return WIRE_PULSE_SIZE;
}

static inline bool wire_pulse_get(struct wire_pulse *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_PULSE_SIZE) {
		return false;
	}
	m->index = wire_get_u32(buf + WIRE_PULSE_INDEX_OFFSET);
	m->scheduled_ticks_leader = wire_get_u64(buf + WIRE_PULSE_SCHEDULED_TICKS_LEADER_OFFSET);
	m->compare_ticks_node = wire_get_u64(buf + WIRE_PULSE_COMPARE_TICKS_NODE_OFFSET);
	m->captured_ticks_node = wire_get_u64(buf + WIRE_PULSE_CAPTURED_TICKS_NODE_OFFSET);
	m->flags = wire_get_u8(buf + WIRE_PULSE_FLAGS_OFFSET);
	return true;
}

/* Counters of the IMU FIFO since boot. */
#define WIRE_FIFO_STATS_ID 7u
#define WIRE_FIFO_STATS_SIZE 81u
#define WIRE_FIFO_STATS_T_TICKS_NODE_OFFSET 0u
#define WIRE_FIFO_STATS_SAMPLES_OFFSET 8u
#define WIRE_FIFO_STATS_BATCHES_OFFSET 12u
#define WIRE_FIFO_STATS_OVERRUNS_OFFSET 16u
#define WIRE_FIFO_STATS_TAG_GAPS_OFFSET 20u
#define WIRE_FIFO_STATS_PARITY_ERRORS_OFFSET 24u
#define WIRE_FIFO_STATS_CONFIG_CHANGES_OFFSET 28u
#define WIRE_FIFO_STATS_SHORT_READS_OFFSET 32u
#define WIRE_FIFO_STATS_BUS_ERRORS_OFFSET 36u
#define WIRE_FIFO_STATS_MISSED_EDGES_OFFSET 40u
#define WIRE_FIFO_STATS_LEVEL_MAX_OFFSET 44u
#define WIRE_FIFO_STATS_WATERMARK_OFFSET 46u
#define WIRE_FIFO_STATS_BUS_BUSY_US_OFFSET 48u
#define WIRE_FIFO_STATS_ODR_HZ_OFFSET 52u
#define WIRE_FIFO_STATS_DECIMATION_OFFSET 56u
#define WIRE_FIFO_STATS_SAMPLES_CRC32_OFFSET 57u
#define WIRE_FIFO_STATS_SAMPLES_UNSETTLED_OFFSET 61u
#define WIRE_FIFO_STATS_SLOTS_BY_TIME_OFFSET 65u
#define WIRE_FIFO_STATS_EDGES_REFUSED_OFFSET 69u
#define WIRE_FIFO_STATS_RESTARTS_OFFSET 73u
#define WIRE_FIFO_STATS_WAKE_UPS_OFFSET 75u
#define WIRE_FIFO_STATS_WAKE_TO_SAMPLE_US_OFFSET 77u

struct wire_fifo_stats {
	/* When counted. [tick, node clock] */
	uint64_t t_ticks_node;
	/* Sample pairs decoded. [1] */
	uint32_t samples;
	/* Bursts read. [1] */
	uint32_t batches;
	/* FIFO overruns. [1] */
	uint32_t overruns;
	/* Breaks in the tag counter. [1] */
	uint32_t tag_gaps;
	/* Words with wrong tag parity. [1] */
	uint32_t parity_errors;
	/* Config-change words. [1] */
	uint32_t config_changes;
	/* Bursts shorter than the level said. [1] */
	uint32_t short_reads;
	/* SPI transfers that failed. [1] */
	uint32_t bus_errors;
	/* Watermarks found by poll and not by edge. [1] */
	uint32_t missed_edges;
	/* Largest level seen since the last report, words. [1] */
	uint16_t level_max;
	/* Watermark programmed, words. [1] */
	uint16_t watermark;
	/* Time in SPI transfers since boot. [us] */
	uint32_t bus_busy_us;
	/* Nominal output data rate of the sensor. [Hz] */
	float odr_hz;
	/* Samples of the sensor to one of the stream. [1] */
	uint8_t decimation;
	/* CRC-32 (IEEE) over all of `samples`, in order. [1] */
	uint32_t samples_crc32;
	/* Pairs dropped before sensor and clock settled. [1] */
	uint32_t samples_unsettled;
	/* Lost slots that only time could show. [1] */
	uint32_t slots_by_time;
	/* Edges that do not fit the slots around them. [1] */
	uint32_t edges_refused;
	/* Times the sensor had to be set up anew. [1] */
	uint16_t restarts;
	/* Times motion ended a rest. [1] */
	uint16_t wake_ups;
	/* Wake-up edge to first sample, last time. [us] */
	uint32_t wake_to_sample_us;
};

static inline size_t wire_fifo_stats_put(uint8_t *buf, const struct wire_fifo_stats *m)
{
	wire_put_u64(buf + WIRE_FIFO_STATS_T_TICKS_NODE_OFFSET, m->t_ticks_node);
	wire_put_u32(buf + WIRE_FIFO_STATS_SAMPLES_OFFSET, m->samples);
	wire_put_u32(buf + WIRE_FIFO_STATS_BATCHES_OFFSET, m->batches);
	wire_put_u32(buf + WIRE_FIFO_STATS_OVERRUNS_OFFSET, m->overruns);
	wire_put_u32(buf + WIRE_FIFO_STATS_TAG_GAPS_OFFSET, m->tag_gaps);
	wire_put_u32(buf + WIRE_FIFO_STATS_PARITY_ERRORS_OFFSET, m->parity_errors);
	wire_put_u32(buf + WIRE_FIFO_STATS_CONFIG_CHANGES_OFFSET, m->config_changes);
	wire_put_u32(buf + WIRE_FIFO_STATS_SHORT_READS_OFFSET, m->short_reads);
	wire_put_u32(buf + WIRE_FIFO_STATS_BUS_ERRORS_OFFSET, m->bus_errors);
	wire_put_u32(buf + WIRE_FIFO_STATS_MISSED_EDGES_OFFSET, m->missed_edges);
	wire_put_u16(buf + WIRE_FIFO_STATS_LEVEL_MAX_OFFSET, m->level_max);
	wire_put_u16(buf + WIRE_FIFO_STATS_WATERMARK_OFFSET, m->watermark);
	wire_put_u32(buf + WIRE_FIFO_STATS_BUS_BUSY_US_OFFSET, m->bus_busy_us);
	wire_put_f32(buf + WIRE_FIFO_STATS_ODR_HZ_OFFSET, m->odr_hz);
	wire_put_u8(buf + WIRE_FIFO_STATS_DECIMATION_OFFSET, m->decimation);
	wire_put_u32(buf + WIRE_FIFO_STATS_SAMPLES_CRC32_OFFSET, m->samples_crc32);
	wire_put_u32(buf + WIRE_FIFO_STATS_SAMPLES_UNSETTLED_OFFSET, m->samples_unsettled);
	wire_put_u32(buf + WIRE_FIFO_STATS_SLOTS_BY_TIME_OFFSET, m->slots_by_time);
	wire_put_u32(buf + WIRE_FIFO_STATS_EDGES_REFUSED_OFFSET, m->edges_refused);
	wire_put_u16(buf + WIRE_FIFO_STATS_RESTARTS_OFFSET, m->restarts);
	wire_put_u16(buf + WIRE_FIFO_STATS_WAKE_UPS_OFFSET, m->wake_ups);
	wire_put_u32(buf + WIRE_FIFO_STATS_WAKE_TO_SAMPLE_US_OFFSET, m->wake_to_sample_us);
	return WIRE_FIFO_STATS_SIZE;
}

static inline bool wire_fifo_stats_get(struct wire_fifo_stats *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_FIFO_STATS_SIZE) {
		return false;
	}
	m->t_ticks_node = wire_get_u64(buf + WIRE_FIFO_STATS_T_TICKS_NODE_OFFSET);
	m->samples = wire_get_u32(buf + WIRE_FIFO_STATS_SAMPLES_OFFSET);
	m->batches = wire_get_u32(buf + WIRE_FIFO_STATS_BATCHES_OFFSET);
	m->overruns = wire_get_u32(buf + WIRE_FIFO_STATS_OVERRUNS_OFFSET);
	m->tag_gaps = wire_get_u32(buf + WIRE_FIFO_STATS_TAG_GAPS_OFFSET);
	m->parity_errors = wire_get_u32(buf + WIRE_FIFO_STATS_PARITY_ERRORS_OFFSET);
	m->config_changes = wire_get_u32(buf + WIRE_FIFO_STATS_CONFIG_CHANGES_OFFSET);
	m->short_reads = wire_get_u32(buf + WIRE_FIFO_STATS_SHORT_READS_OFFSET);
	m->bus_errors = wire_get_u32(buf + WIRE_FIFO_STATS_BUS_ERRORS_OFFSET);
	m->missed_edges = wire_get_u32(buf + WIRE_FIFO_STATS_MISSED_EDGES_OFFSET);
	m->level_max = wire_get_u16(buf + WIRE_FIFO_STATS_LEVEL_MAX_OFFSET);
	m->watermark = wire_get_u16(buf + WIRE_FIFO_STATS_WATERMARK_OFFSET);
	m->bus_busy_us = wire_get_u32(buf + WIRE_FIFO_STATS_BUS_BUSY_US_OFFSET);
	m->odr_hz = wire_get_f32(buf + WIRE_FIFO_STATS_ODR_HZ_OFFSET);
	m->decimation = wire_get_u8(buf + WIRE_FIFO_STATS_DECIMATION_OFFSET);
	m->samples_crc32 = wire_get_u32(buf + WIRE_FIFO_STATS_SAMPLES_CRC32_OFFSET);
	m->samples_unsettled = wire_get_u32(buf + WIRE_FIFO_STATS_SAMPLES_UNSETTLED_OFFSET);
	m->slots_by_time = wire_get_u32(buf + WIRE_FIFO_STATS_SLOTS_BY_TIME_OFFSET);
	m->edges_refused = wire_get_u32(buf + WIRE_FIFO_STATS_EDGES_REFUSED_OFFSET);
	m->restarts = wire_get_u16(buf + WIRE_FIFO_STATS_RESTARTS_OFFSET);
	m->wake_ups = wire_get_u16(buf + WIRE_FIFO_STATS_WAKE_UPS_OFFSET);
	m->wake_to_sample_us = wire_get_u32(buf + WIRE_FIFO_STATS_WAKE_TO_SAMPLE_US_OFFSET);
	return true;
}

/* State of the BLE link. */
#define WIRE_LINK_STATS_ID 8u
#define WIRE_LINK_STATS_SIZE 51u
#define WIRE_LINK_STATS_T_TICKS_NODE_OFFSET 0u
#define WIRE_LINK_STATS_CONNECTED_OFFSET 8u
#define WIRE_LINK_STATS_PHY_OFFSET 9u
#define WIRE_LINK_STATS_RSSI_DBM_OFFSET 10u
#define WIRE_LINK_STATS_MTU_OFFSET 11u
#define WIRE_LINK_STATS_CONN_INTERVAL_US_OFFSET 13u
#define WIRE_LINK_STATS_EVENTS_OFFSET 17u
#define WIRE_LINK_STATS_CRC_ERRORS_OFFSET 21u
#define WIRE_LINK_STATS_DISCONNECTS_OFFSET 25u
#define WIRE_LINK_STATS_BATCHES_SENT_OFFSET 27u
#define WIRE_LINK_STATS_BATCHES_RECEIVED_OFFSET 31u
#define WIRE_LINK_STATS_BATCHES_LOST_OFFSET 35u
#define WIRE_LINK_STATS_BATCHES_LATE_OFFSET 39u
#define WIRE_LINK_STATS_TX_DROPPED_OFFSET 43u
#define WIRE_LINK_STATS_BAD_PAYLOADS_OFFSET 47u

struct wire_link_stats {
	/* When counted. [tick, node clock] */
	uint64_t t_ticks_node;
	/* 1 when connected. [1] */
	uint8_t connected;
	/* 1: 1M, 2: 2M. [1] */
	uint8_t phy;
	/* Last RSSI; 127 when unknown. [dBm] */
	int8_t rssi_dbm;
	/* ATT MTU. [B] */
	uint16_t mtu;
	/* Interval in use. [us] */
	uint32_t conn_interval_us;
	/* Connection events with at least one capture. [1] */
	uint32_t events;
	/* Packets received with a wrong CRC. [1] */
	uint32_t crc_errors;
	/* Disconnections since boot. [1] */
	uint16_t disconnects;
	/* IMU batches given to the link. [1] */
	uint32_t batches_sent;
	/* IMU batches received from the link. [1] */
	uint32_t batches_received;
	/* Gaps seen in the peer's sample index. [1] */
	uint32_t batches_lost;
	/* Batches older than the lateness limit. [1] */
	uint32_t batches_late;
	/* Messages dropped because the queue was full. [1] */
	uint32_t tx_dropped;
	/* GATT payloads refused. [1] */
	uint32_t bad_payloads;
};

static inline size_t wire_link_stats_put(uint8_t *buf, const struct wire_link_stats *m)
{
	wire_put_u64(buf + WIRE_LINK_STATS_T_TICKS_NODE_OFFSET, m->t_ticks_node);
	wire_put_u8(buf + WIRE_LINK_STATS_CONNECTED_OFFSET, m->connected);
	wire_put_u8(buf + WIRE_LINK_STATS_PHY_OFFSET, m->phy);
	wire_put_i8(buf + WIRE_LINK_STATS_RSSI_DBM_OFFSET, m->rssi_dbm);
	wire_put_u16(buf + WIRE_LINK_STATS_MTU_OFFSET, m->mtu);
	wire_put_u32(buf + WIRE_LINK_STATS_CONN_INTERVAL_US_OFFSET, m->conn_interval_us);
	wire_put_u32(buf + WIRE_LINK_STATS_EVENTS_OFFSET, m->events);
	wire_put_u32(buf + WIRE_LINK_STATS_CRC_ERRORS_OFFSET, m->crc_errors);
	wire_put_u16(buf + WIRE_LINK_STATS_DISCONNECTS_OFFSET, m->disconnects);
	wire_put_u32(buf + WIRE_LINK_STATS_BATCHES_SENT_OFFSET, m->batches_sent);
	wire_put_u32(buf + WIRE_LINK_STATS_BATCHES_RECEIVED_OFFSET, m->batches_received);
	wire_put_u32(buf + WIRE_LINK_STATS_BATCHES_LOST_OFFSET, m->batches_lost);
	wire_put_u32(buf + WIRE_LINK_STATS_BATCHES_LATE_OFFSET, m->batches_late);
	wire_put_u32(buf + WIRE_LINK_STATS_TX_DROPPED_OFFSET, m->tx_dropped);
	wire_put_u32(buf + WIRE_LINK_STATS_BAD_PAYLOADS_OFFSET, m->bad_payloads);
	return WIRE_LINK_STATS_SIZE;
}

static inline bool wire_link_stats_get(struct wire_link_stats *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_LINK_STATS_SIZE) {
		return false;
	}
	m->t_ticks_node = wire_get_u64(buf + WIRE_LINK_STATS_T_TICKS_NODE_OFFSET);
	m->connected = wire_get_u8(buf + WIRE_LINK_STATS_CONNECTED_OFFSET);
	m->phy = wire_get_u8(buf + WIRE_LINK_STATS_PHY_OFFSET);
	m->rssi_dbm = wire_get_i8(buf + WIRE_LINK_STATS_RSSI_DBM_OFFSET);
	m->mtu = wire_get_u16(buf + WIRE_LINK_STATS_MTU_OFFSET);
	m->conn_interval_us = wire_get_u32(buf + WIRE_LINK_STATS_CONN_INTERVAL_US_OFFSET);
	m->events = wire_get_u32(buf + WIRE_LINK_STATS_EVENTS_OFFSET);
	m->crc_errors = wire_get_u32(buf + WIRE_LINK_STATS_CRC_ERRORS_OFFSET);
	m->disconnects = wire_get_u16(buf + WIRE_LINK_STATS_DISCONNECTS_OFFSET);
	m->batches_sent = wire_get_u32(buf + WIRE_LINK_STATS_BATCHES_SENT_OFFSET);
	m->batches_received = wire_get_u32(buf + WIRE_LINK_STATS_BATCHES_RECEIVED_OFFSET);
	m->batches_lost = wire_get_u32(buf + WIRE_LINK_STATS_BATCHES_LOST_OFFSET);
	m->batches_late = wire_get_u32(buf + WIRE_LINK_STATS_BATCHES_LATE_OFFSET);
	m->tx_dropped = wire_get_u32(buf + WIRE_LINK_STATS_TX_DROPPED_OFFSET);
	m->bad_payloads = wire_get_u32(buf + WIRE_LINK_STATS_BAD_PAYLOADS_OFFSET);
	return true;
}

/* State of the estimator after one step. */
#define WIRE_EKF_STATE_ID 9u
#define WIRE_EKF_STATE_SIZE 174u
#define WIRE_EKF_STATE_T_TICKS_LEADER_OFFSET 0u
#define WIRE_EKF_STATE_STEP_OFFSET 8u
#define WIRE_EKF_STATE_POSITION_M_OFFSET 12u
#define WIRE_EKF_STATE_POSITION_M_COUNT 3u
#define WIRE_EKF_STATE_VELOCITY_MPS_OFFSET 24u
#define WIRE_EKF_STATE_VELOCITY_MPS_COUNT 3u
#define WIRE_EKF_STATE_QUATERNION_OFFSET 36u
#define WIRE_EKF_STATE_QUATERNION_COUNT 4u
#define WIRE_EKF_STATE_ACCEL_BIAS_MPS2_OFFSET 52u
#define WIRE_EKF_STATE_ACCEL_BIAS_MPS2_COUNT 3u
#define WIRE_EKF_STATE_GYRO_BIAS_RADPS_OFFSET 64u
#define WIRE_EKF_STATE_GYRO_BIAS_RADPS_COUNT 3u
#define WIRE_EKF_STATE_VARIANCE_OFFSET 76u
#define WIRE_EKF_STATE_VARIANCE_COUNT 15u
#define WIRE_EKF_STATE_INNOVATION_OFFSET 136u
#define WIRE_EKF_STATE_INNOVATION_COUNT 3u
#define WIRE_EKF_STATE_NIS_OFFSET 148u
#define WIRE_EKF_STATE_GATE_OFFSET 152u
#define WIRE_EKF_STATE_FLAGS_OFFSET 156u
#define WIRE_EKF_STATE_CENTRE_VELOCITY_MPS_OFFSET 158u
#define WIRE_EKF_STATE_CENTRE_VELOCITY_MPS_COUNT 3u
#define WIRE_EKF_STATE_CENTRE_HEIGHT_M_OFFSET 170u

struct wire_ekf_state {
	/* Time of the state. [tick, leader clock] */
	uint64_t t_ticks_leader;
	/* Step number. [1] */
	uint32_t step;
	/* World frame, z up. [m] */
	float position_m[3];
	/* World frame, z up. [m/s] */
	float velocity_mps[3];
	/* Body to world, w x y z. [1] */
	float quaternion[4];
	/* Body frame. [m/s^2] */
	float accel_bias_mps2[3];
	/* Body frame. [rad/s] */
	float gyro_bias_radps[3];
	/* Diagonal of P, 15 error states. [1] */
	float variance[15];
	/* Last innovation. [1] */
	float innovation[3];
	/* Normalised innovation squared of the last update. [1] */
	float nis;
	/* Gate that NIS was held against. [1] */
	float gate;
	/* Which updates ran and which were gated. [1] */
	uint16_t flags;
	/* Of the bar's centre, world. [m/s] */
	float centre_velocity_mps[3];
	/* Of the bar's centre, from the start. [m] */
	float centre_height_m;
};

static inline size_t wire_ekf_state_put(uint8_t *buf, const struct wire_ekf_state *m)
{
	wire_put_u64(buf + WIRE_EKF_STATE_T_TICKS_LEADER_OFFSET, m->t_ticks_leader);
	wire_put_u32(buf + WIRE_EKF_STATE_STEP_OFFSET, m->step);
	for (size_t i = 0; i < WIRE_EKF_STATE_POSITION_M_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_POSITION_M_OFFSET + 4u * i, m->position_m[i]);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_VELOCITY_MPS_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_VELOCITY_MPS_OFFSET + 4u * i, m->velocity_mps[i]);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_QUATERNION_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_QUATERNION_OFFSET + 4u * i, m->quaternion[i]);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_ACCEL_BIAS_MPS2_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_ACCEL_BIAS_MPS2_OFFSET + 4u * i,
		    m->accel_bias_mps2[i]);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_GYRO_BIAS_RADPS_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_GYRO_BIAS_RADPS_OFFSET + 4u * i,
		    m->gyro_bias_radps[i]);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_VARIANCE_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_VARIANCE_OFFSET + 4u * i, m->variance[i]);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_INNOVATION_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_INNOVATION_OFFSET + 4u * i, m->innovation[i]);
	}
	wire_put_f32(buf + WIRE_EKF_STATE_NIS_OFFSET, m->nis);
	wire_put_f32(buf + WIRE_EKF_STATE_GATE_OFFSET, m->gate);
	wire_put_u16(buf + WIRE_EKF_STATE_FLAGS_OFFSET, m->flags);
	for (size_t i = 0; i < WIRE_EKF_STATE_CENTRE_VELOCITY_MPS_COUNT; i++) {
		wire_put_f32(buf + WIRE_EKF_STATE_CENTRE_VELOCITY_MPS_OFFSET + 4u * i,
		    m->centre_velocity_mps[i]);
	}
	wire_put_f32(buf + WIRE_EKF_STATE_CENTRE_HEIGHT_M_OFFSET, m->centre_height_m);
	return WIRE_EKF_STATE_SIZE;
}

static inline bool wire_ekf_state_get(struct wire_ekf_state *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_EKF_STATE_SIZE) {
		return false;
	}
	m->t_ticks_leader = wire_get_u64(buf + WIRE_EKF_STATE_T_TICKS_LEADER_OFFSET);
	m->step = wire_get_u32(buf + WIRE_EKF_STATE_STEP_OFFSET);
	for (size_t i = 0; i < WIRE_EKF_STATE_POSITION_M_COUNT; i++) {
		m->position_m[i] = wire_get_f32(buf + WIRE_EKF_STATE_POSITION_M_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_VELOCITY_MPS_COUNT; i++) {
		m->velocity_mps[i] =
		    wire_get_f32(buf + WIRE_EKF_STATE_VELOCITY_MPS_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_QUATERNION_COUNT; i++) {
		m->quaternion[i] = wire_get_f32(buf + WIRE_EKF_STATE_QUATERNION_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_ACCEL_BIAS_MPS2_COUNT; i++) {
		m->accel_bias_mps2[i] =
		    wire_get_f32(buf + WIRE_EKF_STATE_ACCEL_BIAS_MPS2_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_GYRO_BIAS_RADPS_COUNT; i++) {
		m->gyro_bias_radps[i] =
		    wire_get_f32(buf + WIRE_EKF_STATE_GYRO_BIAS_RADPS_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_VARIANCE_COUNT; i++) {
		m->variance[i] = wire_get_f32(buf + WIRE_EKF_STATE_VARIANCE_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_EKF_STATE_INNOVATION_COUNT; i++) {
		m->innovation[i] = wire_get_f32(buf + WIRE_EKF_STATE_INNOVATION_OFFSET + 4u * i);
	}
	m->nis = wire_get_f32(buf + WIRE_EKF_STATE_NIS_OFFSET);
	m->gate = wire_get_f32(buf + WIRE_EKF_STATE_GATE_OFFSET);
	m->flags = wire_get_u16(buf + WIRE_EKF_STATE_FLAGS_OFFSET);
	for (size_t i = 0; i < WIRE_EKF_STATE_CENTRE_VELOCITY_MPS_COUNT; i++) {
		m->centre_velocity_mps[i] =
		    wire_get_f32(buf + WIRE_EKF_STATE_CENTRE_VELOCITY_MPS_OFFSET + 4u * i);
	}
	m->centre_height_m = wire_get_f32(buf + WIRE_EKF_STATE_CENTRE_HEIGHT_M_OFFSET);
	return true;
}

/* Madgwick baseline beside the EKF. */
#define WIRE_ATTITUDE_ID 10u
#define WIRE_ATTITUDE_SIZE 28u
#define WIRE_ATTITUDE_T_TICKS_LEADER_OFFSET 0u
#define WIRE_ATTITUDE_QUATERNION_OFFSET 8u
#define WIRE_ATTITUDE_QUATERNION_COUNT 4u
#define WIRE_ATTITUDE_DIVERGENCE_RAD_OFFSET 24u

struct wire_attitude {
	/* Time of the state. [tick, leader clock] */
	uint64_t t_ticks_leader;
	/* Body to world, w x y z. [1] */
	float quaternion[4];
	/* Angle between baseline and EKF. [rad] */
	float divergence_rad;
};

static inline size_t wire_attitude_put(uint8_t *buf, const struct wire_attitude *m)
{
	wire_put_u64(buf + WIRE_ATTITUDE_T_TICKS_LEADER_OFFSET, m->t_ticks_leader);
	for (size_t i = 0; i < WIRE_ATTITUDE_QUATERNION_COUNT; i++) {
		wire_put_f32(buf + WIRE_ATTITUDE_QUATERNION_OFFSET + 4u * i, m->quaternion[i]);
	}
	wire_put_f32(buf + WIRE_ATTITUDE_DIVERGENCE_RAD_OFFSET, m->divergence_rad);
	return WIRE_ATTITUDE_SIZE;
}

static inline bool wire_attitude_get(struct wire_attitude *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_ATTITUDE_SIZE) {
		return false;
	}
	m->t_ticks_leader = wire_get_u64(buf + WIRE_ATTITUDE_T_TICKS_LEADER_OFFSET);
	for (size_t i = 0; i < WIRE_ATTITUDE_QUATERNION_COUNT; i++) {
		m->quaternion[i] = wire_get_f32(buf + WIRE_ATTITUDE_QUATERNION_OFFSET + 4u * i);
	}
	m->divergence_rad = wire_get_f32(buf + WIRE_ATTITUDE_DIVERGENCE_RAD_OFFSET);
	return true;
}

/* Which calibration is in force and what the boot check found. */
#define WIRE_CAL_STATUS_ID 11u
#define WIRE_CAL_STATUS_SIZE 84u
#define WIRE_CAL_STATUS_T_TICKS_NODE_OFFSET 0u
#define WIRE_CAL_STATUS_ORIGIN_OFFSET 8u
#define WIRE_CAL_STATUS_REASON_OFFSET 9u
#define WIRE_CAL_STATUS_BOOT_CHECK_OFFSET 10u
#define WIRE_CAL_STATUS_BOOT_ATTEMPTS_OFFSET 11u
#define WIRE_CAL_STATUS_READY_OFFSET 12u
#define WIRE_CAL_STATUS_RAW_OFFSET 13u
#define WIRE_CAL_STATUS_RECORD_CRC32_OFFSET 14u
#define WIRE_CAL_STATUS_ACCEL_BIAS_MPS2_OFFSET 18u
#define WIRE_CAL_STATUS_ACCEL_BIAS_MPS2_COUNT 3u
#define WIRE_CAL_STATUS_ACCEL_MATRIX_OFFSET 30u
#define WIRE_CAL_STATUS_ACCEL_MATRIX_COUNT 9u
#define WIRE_CAL_STATUS_GYRO_BIAS_RADPS_OFFSET 66u
#define WIRE_CAL_STATUS_GYRO_BIAS_RADPS_COUNT 3u
#define WIRE_CAL_STATUS_BOOT_DELTA_DPS_OFFSET 78u
#define WIRE_CAL_STATUS_TEMPERATURE_CDEGC_OFFSET 82u
#define WIRE_CAL_STATUS_TEMPERATURE_CDEGC_SCALE 0.01

struct wire_cal_status {
	/* When decided. [tick, node clock] */
	uint64_t t_ticks_node;
	/* A value of CAL_ORIGINS. [1] */
	uint8_t origin;
	/* Why defaults: a value of CAL_REASONS. [1] */
	uint8_t reason;
	/* A value of BOOT_CHECKS. [1] */
	uint8_t boot_check;
	/* Windows of stillness tried; 255: that or more. [1] */
	uint8_t boot_attempts;
	/* 1 once the boot check has decided. [1] */
	uint8_t ready;
	/* 1 while the host has the correction switched off. [1] */
	uint8_t raw;
	/* CRC-32 of the record in force; 0 for defaults. [1] */
	uint32_t record_crc32;
	/* Bias in force. [m/s^2] */
	float accel_bias_mps2[3];
	/* Correction in force, row by row. [1] */
	float accel_matrix[9];
	/* Bias in force. [rad/s] */
	float gyro_bias_radps[3];
	/* Boot bias minus stored bias, magnitude. [dps] */
	float boot_delta_dps;
	/* Die temperature at the check. [0.01 degC] */
	int16_t temperature_cdegc;
};

static inline size_t wire_cal_status_put(uint8_t *buf, const struct wire_cal_status *m)
{
	wire_put_u64(buf + WIRE_CAL_STATUS_T_TICKS_NODE_OFFSET, m->t_ticks_node);
	wire_put_u8(buf + WIRE_CAL_STATUS_ORIGIN_OFFSET, m->origin);
	wire_put_u8(buf + WIRE_CAL_STATUS_REASON_OFFSET, m->reason);
	wire_put_u8(buf + WIRE_CAL_STATUS_BOOT_CHECK_OFFSET, m->boot_check);
	wire_put_u8(buf + WIRE_CAL_STATUS_BOOT_ATTEMPTS_OFFSET, m->boot_attempts);
	wire_put_u8(buf + WIRE_CAL_STATUS_READY_OFFSET, m->ready);
	wire_put_u8(buf + WIRE_CAL_STATUS_RAW_OFFSET, m->raw);
	wire_put_u32(buf + WIRE_CAL_STATUS_RECORD_CRC32_OFFSET, m->record_crc32);
	for (size_t i = 0; i < WIRE_CAL_STATUS_ACCEL_BIAS_MPS2_COUNT; i++) {
		wire_put_f32(buf + WIRE_CAL_STATUS_ACCEL_BIAS_MPS2_OFFSET + 4u * i,
		    m->accel_bias_mps2[i]);
	}
	for (size_t i = 0; i < WIRE_CAL_STATUS_ACCEL_MATRIX_COUNT; i++) {
		wire_put_f32(buf + WIRE_CAL_STATUS_ACCEL_MATRIX_OFFSET + 4u * i,
		    m->accel_matrix[i]);
	}
	for (size_t i = 0; i < WIRE_CAL_STATUS_GYRO_BIAS_RADPS_COUNT; i++) {
		wire_put_f32(buf + WIRE_CAL_STATUS_GYRO_BIAS_RADPS_OFFSET + 4u * i,
		    m->gyro_bias_radps[i]);
	}
	wire_put_f32(buf + WIRE_CAL_STATUS_BOOT_DELTA_DPS_OFFSET, m->boot_delta_dps);
	wire_put_i16(buf + WIRE_CAL_STATUS_TEMPERATURE_CDEGC_OFFSET, m->temperature_cdegc);
	return WIRE_CAL_STATUS_SIZE;
}

static inline bool wire_cal_status_get(struct wire_cal_status *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_CAL_STATUS_SIZE) {
		return false;
	}
	m->t_ticks_node = wire_get_u64(buf + WIRE_CAL_STATUS_T_TICKS_NODE_OFFSET);
	m->origin = wire_get_u8(buf + WIRE_CAL_STATUS_ORIGIN_OFFSET);
	m->reason = wire_get_u8(buf + WIRE_CAL_STATUS_REASON_OFFSET);
	m->boot_check = wire_get_u8(buf + WIRE_CAL_STATUS_BOOT_CHECK_OFFSET);
	m->boot_attempts = wire_get_u8(buf + WIRE_CAL_STATUS_BOOT_ATTEMPTS_OFFSET);
	m->ready = wire_get_u8(buf + WIRE_CAL_STATUS_READY_OFFSET);
	m->raw = wire_get_u8(buf + WIRE_CAL_STATUS_RAW_OFFSET);
	m->record_crc32 = wire_get_u32(buf + WIRE_CAL_STATUS_RECORD_CRC32_OFFSET);
	for (size_t i = 0; i < WIRE_CAL_STATUS_ACCEL_BIAS_MPS2_COUNT; i++) {
		m->accel_bias_mps2[i] =
		    wire_get_f32(buf + WIRE_CAL_STATUS_ACCEL_BIAS_MPS2_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_CAL_STATUS_ACCEL_MATRIX_COUNT; i++) {
		m->accel_matrix[i] =
		    wire_get_f32(buf + WIRE_CAL_STATUS_ACCEL_MATRIX_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_CAL_STATUS_GYRO_BIAS_RADPS_COUNT; i++) {
		m->gyro_bias_radps[i] =
		    wire_get_f32(buf + WIRE_CAL_STATUS_GYRO_BIAS_RADPS_OFFSET + 4u * i);
	}
	m->boot_delta_dps = wire_get_f32(buf + WIRE_CAL_STATUS_BOOT_DELTA_DPS_OFFSET);
	m->temperature_cdegc = wire_get_i16(buf + WIRE_CAL_STATUS_TEMPERATURE_CDEGC_OFFSET);
	return true;
}

/* Health of the node. */
#define WIRE_SYSTEM_ID 12u
#define WIRE_SYSTEM_SIZE 28u
#define WIRE_SYSTEM_T_TICKS_NODE_OFFSET 0u
#define WIRE_SYSTEM_CPU_LOAD_PERMILLE_OFFSET 8u
#define WIRE_SYSTEM_CPU_LOAD_PERMILLE_SCALE 0.001
#define WIRE_SYSTEM_STACK_FREE_MIN_B_OFFSET 10u
#define WIRE_SYSTEM_HEAP_USED_B_OFFSET 12u
#define WIRE_SYSTEM_HEAP_PEAK_B_OFFSET 16u
#define WIRE_SYSTEM_UART_DROPPED_OFFSET 20u
#define WIRE_SYSTEM_TIMER_WRAPS_OFFSET 24u

struct wire_system {
	/* When measured. [tick, node clock] */
	uint64_t t_ticks_node;
	/* Non-idle share since the last report. [0.001 1] */
	uint16_t cpu_load_permille;
	/* Smallest stack headroom of any thread. [B] */
	uint16_t stack_free_min_b;
	/* System heap in use. [B] */
	uint32_t heap_used_b;
	/* System heap high-water mark. [B] */
	uint32_t heap_peak_b;
	/* Frames dropped because the line was full. [1] */
	uint32_t uart_dropped;
	/* Wraps of the 32-bit TIMER. [1] */
	uint32_t timer_wraps;
};

static inline size_t wire_system_put(uint8_t *buf, const struct wire_system *m)
{
	wire_put_u64(buf + WIRE_SYSTEM_T_TICKS_NODE_OFFSET, m->t_ticks_node);
	wire_put_u16(buf + WIRE_SYSTEM_CPU_LOAD_PERMILLE_OFFSET, m->cpu_load_permille);
	wire_put_u16(buf + WIRE_SYSTEM_STACK_FREE_MIN_B_OFFSET, m->stack_free_min_b);
	wire_put_u32(buf + WIRE_SYSTEM_HEAP_USED_B_OFFSET, m->heap_used_b);
	wire_put_u32(buf + WIRE_SYSTEM_HEAP_PEAK_B_OFFSET, m->heap_peak_b);
	wire_put_u32(buf + WIRE_SYSTEM_UART_DROPPED_OFFSET, m->uart_dropped);
	wire_put_u32(buf + WIRE_SYSTEM_TIMER_WRAPS_OFFSET, m->timer_wraps);
	return WIRE_SYSTEM_SIZE;
}

static inline bool wire_system_get(struct wire_system *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_SYSTEM_SIZE) {
		return false;
	}
	m->t_ticks_node = wire_get_u64(buf + WIRE_SYSTEM_T_TICKS_NODE_OFFSET);
	m->cpu_load_permille = wire_get_u16(buf + WIRE_SYSTEM_CPU_LOAD_PERMILLE_OFFSET);
	m->stack_free_min_b = wire_get_u16(buf + WIRE_SYSTEM_STACK_FREE_MIN_B_OFFSET);
	m->heap_used_b = wire_get_u32(buf + WIRE_SYSTEM_HEAP_USED_B_OFFSET);
	m->heap_peak_b = wire_get_u32(buf + WIRE_SYSTEM_HEAP_PEAK_B_OFFSET);
	m->uart_dropped = wire_get_u32(buf + WIRE_SYSTEM_UART_DROPPED_OFFSET);
	m->timer_wraps = wire_get_u32(buf + WIRE_SYSTEM_TIMER_WRAPS_OFFSET);
	return true;
}

/* Something is wrong and a person should act. */
#define WIRE_FAULT_ID 13u
#define WIRE_FAULT_SIZE 62u
#define WIRE_FAULT_T_TICKS_NODE_OFFSET 0u
#define WIRE_FAULT_CODE_OFFSET 8u
#define WIRE_FAULT_ARGUMENT_OFFSET 10u
#define WIRE_FAULT_DETAIL_OFFSET 14u
#define WIRE_FAULT_DETAIL_COUNT 48u

struct wire_fault {
	/* When noticed. [tick, node clock] */
	uint64_t t_ticks_node;
	/* A value of FAULT_CODES. [1] */
	uint16_t code;
	/* Depends on the code. [1] */
	uint32_t argument;
	/* ASCII, zero padded. [1] */
	uint8_t detail[48];
};

static inline size_t wire_fault_put(uint8_t *buf, const struct wire_fault *m)
{
	wire_put_u64(buf + WIRE_FAULT_T_TICKS_NODE_OFFSET, m->t_ticks_node);
	wire_put_u16(buf + WIRE_FAULT_CODE_OFFSET, m->code);
	wire_put_u32(buf + WIRE_FAULT_ARGUMENT_OFFSET, m->argument);
	for (size_t i = 0; i < WIRE_FAULT_DETAIL_COUNT; i++) {
		wire_put_u8(buf + WIRE_FAULT_DETAIL_OFFSET + i, m->detail[i]);
	}
	return WIRE_FAULT_SIZE;
}

static inline bool wire_fault_get(struct wire_fault *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_FAULT_SIZE) {
		return false;
	}
	m->t_ticks_node = wire_get_u64(buf + WIRE_FAULT_T_TICKS_NODE_OFFSET);
	m->code = wire_get_u16(buf + WIRE_FAULT_CODE_OFFSET);
	m->argument = wire_get_u32(buf + WIRE_FAULT_ARGUMENT_OFFSET);
	for (size_t i = 0; i < WIRE_FAULT_DETAIL_COUNT; i++) {
		m->detail[i] = wire_get_u8(buf + WIRE_FAULT_DETAIL_OFFSET + i);
	}
	return true;
}

/* Host to node: start the IMU anew with these settings; 0 leaves one as the image has it. */
#define WIRE_IMU_SETUP_ID 14u
#define WIRE_IMU_SETUP_SIZE 9u
#define WIRE_IMU_SETUP_ODR_HZ_OFFSET 0u
#define WIRE_IMU_SETUP_ACCEL_FS_G_OFFSET 4u
#define WIRE_IMU_SETUP_GYRO_FS_DPS_OFFSET 5u
#define WIRE_IMU_SETUP_REST_S_OFFSET 7u

struct wire_imu_setup {
	/* Output data rate; the nearest one is taken. [Hz] */
	float odr_hz;
	/* Accelerometer full scale: 2, 4, 8, 16. [g] */
	uint8_t accel_fs_g;
	/* Gyroscope full scale: 125, 250, 500, 1000, 2000. [dps] */
	uint16_t gyro_fs_dps;
	/* Stillness after which the sensor rests; 65535: never. [s] */
	uint16_t rest_s;
};

static inline size_t wire_imu_setup_put(uint8_t *buf, const struct wire_imu_setup *m)
{
	wire_put_f32(buf + WIRE_IMU_SETUP_ODR_HZ_OFFSET, m->odr_hz);
	wire_put_u8(buf + WIRE_IMU_SETUP_ACCEL_FS_G_OFFSET, m->accel_fs_g);
	wire_put_u16(buf + WIRE_IMU_SETUP_GYRO_FS_DPS_OFFSET, m->gyro_fs_dps);
	wire_put_u16(buf + WIRE_IMU_SETUP_REST_S_OFFSET, m->rest_s);
	return WIRE_IMU_SETUP_SIZE;
}

static inline bool wire_imu_setup_get(struct wire_imu_setup *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_IMU_SETUP_SIZE) {
		return false;
	}
	m->odr_hz = wire_get_f32(buf + WIRE_IMU_SETUP_ODR_HZ_OFFSET);
	m->accel_fs_g = wire_get_u8(buf + WIRE_IMU_SETUP_ACCEL_FS_G_OFFSET);
	m->gyro_fs_dps = wire_get_u16(buf + WIRE_IMU_SETUP_GYRO_FS_DPS_OFFSET);
	m->rest_s = wire_get_u16(buf + WIRE_IMU_SETUP_REST_S_OFFSET);
	return true;
}

/* Host to node: end the BLE connection; the nodes then connect anew by themselves. */
#define WIRE_LINK_DROP_ID 15u
#define WIRE_LINK_DROP_SIZE 2u
#define WIRE_LINK_DROP_HOLD_MS_OFFSET 0u

struct wire_link_drop {
	/* How long this node stays away from the radio first. [ms] */
	uint16_t hold_ms;
};

static inline size_t wire_link_drop_put(uint8_t *buf, const struct wire_link_drop *m)
{
	wire_put_u16(buf + WIRE_LINK_DROP_HOLD_MS_OFFSET, m->hold_ms);
	return WIRE_LINK_DROP_SIZE;
}

static inline bool wire_link_drop_get(struct wire_link_drop *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_LINK_DROP_SIZE) {
		return false;
	}
	m->hold_ms = wire_get_u16(buf + WIRE_LINK_DROP_HOLD_MS_OFFSET);
	return true;
}

/* A calibration. Host to node: store it. Node to host: what its store holds. */
#define WIRE_CAL_RECORD_ID 16u
#define WIRE_CAL_RECORD_SIZE 74u
#define WIRE_CAL_RECORD_DEVICE_ID_OFFSET 0u
#define WIRE_CAL_RECORD_CREATED_UNIX_S_OFFSET 8u
#define WIRE_CAL_RECORD_TEMPERATURE_CDEGC_OFFSET 12u
#define WIRE_CAL_RECORD_TEMPERATURE_CDEGC_SCALE 0.01
#define WIRE_CAL_RECORD_ACCEL_BIAS_MPS2_OFFSET 14u
#define WIRE_CAL_RECORD_ACCEL_BIAS_MPS2_COUNT 3u
#define WIRE_CAL_RECORD_ACCEL_MATRIX_OFFSET 26u
#define WIRE_CAL_RECORD_ACCEL_MATRIX_COUNT 9u
#define WIRE_CAL_RECORD_GYRO_BIAS_RADPS_OFFSET 62u
#define WIRE_CAL_RECORD_GYRO_BIAS_RADPS_COUNT 3u

struct wire_cal_record {
	/* FICR DEVICEID of the node it was measured on. [1] */
	uint64_t device_id;
	/* When it was measured, Unix time. [s] */
	uint32_t created_unix_s;
	/* Die temperature meanwhile. [0.01 degC] */
	int16_t temperature_cdegc;
	/* b in a = M (raw - b). [m/s^2] */
	float accel_bias_mps2[3];
	/* M in a = M (raw - b), row by row. [1] */
	float accel_matrix[9];
	/* Subtracted from the raw rate. [rad/s] */
	float gyro_bias_radps[3];
};

static inline size_t wire_cal_record_put(uint8_t *buf, const struct wire_cal_record *m)
{
	wire_put_u64(buf + WIRE_CAL_RECORD_DEVICE_ID_OFFSET, m->device_id);
	wire_put_u32(buf + WIRE_CAL_RECORD_CREATED_UNIX_S_OFFSET, m->created_unix_s);
	wire_put_i16(buf + WIRE_CAL_RECORD_TEMPERATURE_CDEGC_OFFSET, m->temperature_cdegc);
	for (size_t i = 0; i < WIRE_CAL_RECORD_ACCEL_BIAS_MPS2_COUNT; i++) {
		wire_put_f32(buf + WIRE_CAL_RECORD_ACCEL_BIAS_MPS2_OFFSET + 4u * i,
		    m->accel_bias_mps2[i]);
	}
	for (size_t i = 0; i < WIRE_CAL_RECORD_ACCEL_MATRIX_COUNT; i++) {
		wire_put_f32(buf + WIRE_CAL_RECORD_ACCEL_MATRIX_OFFSET + 4u * i,
		    m->accel_matrix[i]);
	}
	for (size_t i = 0; i < WIRE_CAL_RECORD_GYRO_BIAS_RADPS_COUNT; i++) {
		wire_put_f32(buf + WIRE_CAL_RECORD_GYRO_BIAS_RADPS_OFFSET + 4u * i,
		    m->gyro_bias_radps[i]);
	}
	return WIRE_CAL_RECORD_SIZE;
}

static inline bool wire_cal_record_get(struct wire_cal_record *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_CAL_RECORD_SIZE) {
		return false;
	}
	m->device_id = wire_get_u64(buf + WIRE_CAL_RECORD_DEVICE_ID_OFFSET);
	m->created_unix_s = wire_get_u32(buf + WIRE_CAL_RECORD_CREATED_UNIX_S_OFFSET);
	m->temperature_cdegc = wire_get_i16(buf + WIRE_CAL_RECORD_TEMPERATURE_CDEGC_OFFSET);
	for (size_t i = 0; i < WIRE_CAL_RECORD_ACCEL_BIAS_MPS2_COUNT; i++) {
		m->accel_bias_mps2[i] =
		    wire_get_f32(buf + WIRE_CAL_RECORD_ACCEL_BIAS_MPS2_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_CAL_RECORD_ACCEL_MATRIX_COUNT; i++) {
		m->accel_matrix[i] =
		    wire_get_f32(buf + WIRE_CAL_RECORD_ACCEL_MATRIX_OFFSET + 4u * i);
	}
	for (size_t i = 0; i < WIRE_CAL_RECORD_GYRO_BIAS_RADPS_COUNT; i++) {
		m->gyro_bias_radps[i] =
		    wire_get_f32(buf + WIRE_CAL_RECORD_GYRO_BIAS_RADPS_OFFSET + 4u * i);
	}
	return true;
}

/* Host to node: do this now. */
#define WIRE_NODE_COMMAND_ID 17u
#define WIRE_NODE_COMMAND_SIZE 1u
#define WIRE_NODE_COMMAND_COMMAND_OFFSET 0u

struct wire_node_command {
	/* A value of NODE_COMMANDS. [1] */
	uint8_t command;
};

static inline size_t wire_node_command_put(uint8_t *buf, const struct wire_node_command *m)
{
	wire_put_u8(buf + WIRE_NODE_COMMAND_COMMAND_OFFSET, m->command);
	return WIRE_NODE_COMMAND_SIZE;
}

static inline bool wire_node_command_get(struct wire_node_command *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_NODE_COMMAND_SIZE) {
		return false;
	}
	m->command = wire_get_u8(buf + WIRE_NODE_COMMAND_COMMAND_OFFSET);
	return true;
}

/* One repetition, once it has ended; again, by the same number, when more is known of it. */
#define WIRE_REP_ID 18u
#define WIRE_REP_SIZE 57u
#define WIRE_REP_SET_OFFSET 0u
#define WIRE_REP_NUMBER_OFFSET 2u
#define WIRE_REP_KIND_OFFSET 4u
#define WIRE_REP_FLAGS_OFFSET 5u
#define WIRE_REP_PHASES_OFFSET 6u
#define WIRE_REP_FULL_COUNT_OFFSET 7u
#define WIRE_REP_T_START_TICKS_LEADER_OFFSET 9u
#define WIRE_REP_T_END_TICKS_LEADER_OFFSET 17u
#define WIRE_REP_MEAN_MPS_OFFSET 25u
#define WIRE_REP_PEAK_MPS_OFFSET 29u
#define WIRE_REP_TIME_TO_PEAK_S_OFFSET 33u
#define WIRE_REP_ECCENTRIC_S_OFFSET 37u
#define WIRE_REP_PAUSE_S_OFFSET 41u
#define WIRE_REP_RANGE_M_OFFSET 45u
#define WIRE_REP_TILT_RAD_OFFSET 49u
#define WIRE_REP_VELOCITY_LOSS_OFFSET 53u

struct wire_rep {
	/* Sets since boot; a gap in the estimate begins a new one. [1] */
	uint16_t set;
	/* Counts the repetitions reported in the set, from 1. [1] */
	uint16_t number;
	/* A value of REP_KINDS; none: it was no repetition after all. [1] */
	uint8_t kind;
	/* Bits of REP_FLAGS. [1] */
	uint8_t flags;
	/* Concentric phases: more than one in a clean and jerk. [1] */
	uint8_t phases;
	/* Full repetitions of the set up to this one. [1] */
	uint16_t full_count;
	/* Begins to rise. [tick, leader clock] */
	uint64_t t_start_ticks_leader;
	/* Has risen. [tick, leader clock] */
	uint64_t t_end_ticks_leader;
	/* Mean velocity, of the fastest phase. [m/s] */
	float mean_mps;
	/* Peak velocity, of the fastest phase. [m/s] */
	float peak_mps;
	/* From the beginning of that phase to its peak. [s] */
	float time_to_peak_s;
	/* How long the bar was lowered; NaN: not, or not yet. [s] */
	float eccentric_s;
	/* From lowered to rising; NaN: not lowered before. [s] */
	float pause_s;
	/* From the lowest to the highest point of the lift. [m] */
	float range_m;
	/* Largest tilt of the bar, leader's end up. [rad] */
	float tilt_rad;
	/* Mean velocity against the fastest full one up to it; NaN: partial, or the first. [1] */
	float velocity_loss;
};

static inline size_t wire_rep_put(uint8_t *buf, const struct wire_rep *m)
{
	wire_put_u16(buf + WIRE_REP_SET_OFFSET, m->set);
	wire_put_u16(buf + WIRE_REP_NUMBER_OFFSET, m->number);
	wire_put_u8(buf + WIRE_REP_KIND_OFFSET, m->kind);
	wire_put_u8(buf + WIRE_REP_FLAGS_OFFSET, m->flags);
	wire_put_u8(buf + WIRE_REP_PHASES_OFFSET, m->phases);
	wire_put_u16(buf + WIRE_REP_FULL_COUNT_OFFSET, m->full_count);
	wire_put_u64(buf + WIRE_REP_T_START_TICKS_LEADER_OFFSET, m->t_start_ticks_leader);
	wire_put_u64(buf + WIRE_REP_T_END_TICKS_LEADER_OFFSET, m->t_end_ticks_leader);
	wire_put_f32(buf + WIRE_REP_MEAN_MPS_OFFSET, m->mean_mps);
	wire_put_f32(buf + WIRE_REP_PEAK_MPS_OFFSET, m->peak_mps);
	wire_put_f32(buf + WIRE_REP_TIME_TO_PEAK_S_OFFSET, m->time_to_peak_s);
	wire_put_f32(buf + WIRE_REP_ECCENTRIC_S_OFFSET, m->eccentric_s);
	wire_put_f32(buf + WIRE_REP_PAUSE_S_OFFSET, m->pause_s);
	wire_put_f32(buf + WIRE_REP_RANGE_M_OFFSET, m->range_m);
	wire_put_f32(buf + WIRE_REP_TILT_RAD_OFFSET, m->tilt_rad);
	wire_put_f32(buf + WIRE_REP_VELOCITY_LOSS_OFFSET, m->velocity_loss);
	return WIRE_REP_SIZE;
}

static inline bool wire_rep_get(struct wire_rep *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_REP_SIZE) {
		return false;
	}
	m->set = wire_get_u16(buf + WIRE_REP_SET_OFFSET);
	m->number = wire_get_u16(buf + WIRE_REP_NUMBER_OFFSET);
	m->kind = wire_get_u8(buf + WIRE_REP_KIND_OFFSET);
	m->flags = wire_get_u8(buf + WIRE_REP_FLAGS_OFFSET);
	m->phases = wire_get_u8(buf + WIRE_REP_PHASES_OFFSET);
	m->full_count = wire_get_u16(buf + WIRE_REP_FULL_COUNT_OFFSET);
	m->t_start_ticks_leader = wire_get_u64(buf + WIRE_REP_T_START_TICKS_LEADER_OFFSET);
	m->t_end_ticks_leader = wire_get_u64(buf + WIRE_REP_T_END_TICKS_LEADER_OFFSET);
	m->mean_mps = wire_get_f32(buf + WIRE_REP_MEAN_MPS_OFFSET);
	m->peak_mps = wire_get_f32(buf + WIRE_REP_PEAK_MPS_OFFSET);
	m->time_to_peak_s = wire_get_f32(buf + WIRE_REP_TIME_TO_PEAK_S_OFFSET);
	m->eccentric_s = wire_get_f32(buf + WIRE_REP_ECCENTRIC_S_OFFSET);
	m->pause_s = wire_get_f32(buf + WIRE_REP_PAUSE_S_OFFSET);
	m->range_m = wire_get_f32(buf + WIRE_REP_RANGE_M_OFFSET);
	m->tilt_rad = wire_get_f32(buf + WIRE_REP_TILT_RAD_OFFSET);
	m->velocity_loss = wire_get_f32(buf + WIRE_REP_VELOCITY_LOSS_OFFSET);
	return true;
}

/* Host to node: the key that both nodes prove to each other; zeros: the image's own again. */
#define WIRE_LINK_KEY_ID 19u
#define WIRE_LINK_KEY_SIZE 16u
#define WIRE_LINK_KEY_KEY_OFFSET 0u
#define WIRE_LINK_KEY_KEY_COUNT 16u

struct wire_link_key {
	/* 128 bits, from a source of randomness. [1] */
	uint8_t key[16];
};

static inline size_t wire_link_key_put(uint8_t *buf, const struct wire_link_key *m)
{
	for (size_t i = 0; i < WIRE_LINK_KEY_KEY_COUNT; i++) {
		wire_put_u8(buf + WIRE_LINK_KEY_KEY_OFFSET + i, m->key[i]);
	}
	return WIRE_LINK_KEY_SIZE;
}

static inline bool wire_link_key_get(struct wire_link_key *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_LINK_KEY_SIZE) {
		return false;
	}
	for (size_t i = 0; i < WIRE_LINK_KEY_KEY_COUNT; i++) {
		m->key[i] = wire_get_u8(buf + WIRE_LINK_KEY_KEY_OFFSET + i);
	}
	return true;
}

/* How the link is kept to the one peer. */
#define WIRE_LINK_SECURITY_ID 20u
#define WIRE_LINK_SECURITY_SIZE 14u
#define WIRE_LINK_SECURITY_T_TICKS_NODE_OFFSET 0u
#define WIRE_LINK_SECURITY_KEY_OFFSET 8u
#define WIRE_LINK_SECURITY_SECURE_OFFSET 9u
#define WIRE_LINK_SECURITY_REFUSED_OFFSET 10u

struct wire_link_security {
	/* When counted. [tick, node clock] */
	uint64_t t_ticks_node;
	/* A value of LINK_KEY_ORIGINS: the one in force. [1] */
	uint8_t key;
	/* 1: the peer has proved the key, all is encrypted. [1] */
	uint8_t secure;
	/* Connections ended as the peer did not prove the key. [1] */
	uint32_t refused;
};

static inline size_t wire_link_security_put(uint8_t *buf, const struct wire_link_security *m)
{
	wire_put_u64(buf + WIRE_LINK_SECURITY_T_TICKS_NODE_OFFSET, m->t_ticks_node);
	wire_put_u8(buf + WIRE_LINK_SECURITY_KEY_OFFSET, m->key);
	wire_put_u8(buf + WIRE_LINK_SECURITY_SECURE_OFFSET, m->secure);
	wire_put_u32(buf + WIRE_LINK_SECURITY_REFUSED_OFFSET, m->refused);
	return WIRE_LINK_SECURITY_SIZE;
}

static inline bool wire_link_security_get(struct wire_link_security *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_LINK_SECURITY_SIZE) {
		return false;
	}
	m->t_ticks_node = wire_get_u64(buf + WIRE_LINK_SECURITY_T_TICKS_NODE_OFFSET);
	m->key = wire_get_u8(buf + WIRE_LINK_SECURITY_KEY_OFFSET);
	m->secure = wire_get_u8(buf + WIRE_LINK_SECURITY_SECURE_OFFSET);
	m->refused = wire_get_u32(buf + WIRE_LINK_SECURITY_REFUSED_OFFSET);
	return true;
}

/* Stack of one thread; one thread a second, in turn. */
#define WIRE_THREAD_ID 21u
#define WIRE_THREAD_SIZE 32u
#define WIRE_THREAD_T_TICKS_NODE_OFFSET 0u
#define WIRE_THREAD_NAME_OFFSET 8u
#define WIRE_THREAD_NAME_COUNT 16u
#define WIRE_THREAD_STACK_SIZE_B_OFFSET 24u
#define WIRE_THREAD_STACK_FREE_B_OFFSET 28u

struct wire_thread {
	/* When measured. [tick, node clock] */
	uint64_t t_ticks_node;
	/* ASCII, zero padded. [1] */
	uint8_t name[16];
	/* Size of its stack. [B] */
	uint32_t stack_size_b;
	/* Never used since boot; in simulation meaningless. [B] */
	uint32_t stack_free_b;
};

static inline size_t wire_thread_put(uint8_t *buf, const struct wire_thread *m)
{
	wire_put_u64(buf + WIRE_THREAD_T_TICKS_NODE_OFFSET, m->t_ticks_node);
	for (size_t i = 0; i < WIRE_THREAD_NAME_COUNT; i++) {
		wire_put_u8(buf + WIRE_THREAD_NAME_OFFSET + i, m->name[i]);
	}
	wire_put_u32(buf + WIRE_THREAD_STACK_SIZE_B_OFFSET, m->stack_size_b);
	wire_put_u32(buf + WIRE_THREAD_STACK_FREE_B_OFFSET, m->stack_free_b);
	return WIRE_THREAD_SIZE;
}

static inline bool wire_thread_get(struct wire_thread *m, const uint8_t *buf,
					size_t len)
{
	if (len != WIRE_THREAD_SIZE) {
		return false;
	}
	m->t_ticks_node = wire_get_u64(buf + WIRE_THREAD_T_TICKS_NODE_OFFSET);
	for (size_t i = 0; i < WIRE_THREAD_NAME_COUNT; i++) {
		m->name[i] = wire_get_u8(buf + WIRE_THREAD_NAME_OFFSET + i);
	}
	m->stack_size_b = wire_get_u32(buf + WIRE_THREAD_STACK_SIZE_B_OFFSET);
	m->stack_free_b = wire_get_u32(buf + WIRE_THREAD_STACK_FREE_B_OFFSET);
	return true;
}

#endif /* WIRE_H_ */
