/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The LSM6DSOX as a stream of batches with hardware times.
 *
 * Parts: lsm6dsox_bus (SPI), lsm6dsox_config (registers), lsm6dsox_edge (hardware time of INT1),
 * lsm6dsox_decoder (FIFO words to pairs), lsm6dsox_timing (slot times), lsm6dsox_rest (when to
 * sleep) and lsm6dsox_stream, which joins them. The decoder, the timing and the rest detector are
 * plain C and know nothing of Zephyr.
 */
#ifndef BV_LSM6DSOX_H_
#define BV_LSM6DSOX_H_

#include <stdint.h>

#include <zephyr/device.h>

#include "lsm6dsox_decoder.h"
#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Counts since start, but for the values that say otherwise. */
struct lsm6dsox_stats {
	struct lsm6dsox_decoder_counters fifo;
	/** Pairs delivered in batches. */
	uint32_t samples;
	/** CRC-32 (IEEE) over all of them in order: gyro xyz, accel xyz as little-endian i16. */
	uint32_t samples_crc32;
	/** Bursts read. */
	uint32_t bursts;
	/** Times the chip said that its FIFO overran. */
	uint32_t overruns;
	/** SPI transfers that failed or gave an answer the chip cannot give. */
	uint32_t bus_errors;
	/** Watermarks found by poll and not by edge. */
	uint32_t missed_edges;
	/** Captured edges that do not fit the slots around them. */
	uint32_t edges_refused;
	/** Slots that the slot counter could not show to be lost, found by time. */
	uint32_t slots_resolved_by_time;
	/** Times the chip had to be set up again. */
	uint32_t restarts;
	/** Pairs dropped because a sensor or the timing had not settled. */
	uint32_t pairs_unsettled;
	/** Wake-ups from rest. */
	uint32_t wake_ups;
	/** From the wake-up edge to the first delivered sample, of the last wake-up. */
	uint32_t wake_to_sample_us;
	/** Time in SPI transfers. */
	uint64_t bus_busy_ticks;
	/** Largest FIFO level since the last lsm6dsox_get_stats(), words. */
	uint16_t level_max;
	/** Watermark in use, words. */
	uint16_t watermark;
	/** Nominal rate in use. */
	float odr_hz;
};

/** How to stream. */
struct lsm6dsox_options {
	/** The nearest of the chip's rates is taken: 12.5 Hz * 2^n, up to 6667 Hz. */
	uint16_t rate_hz;
	/** 2, 4, 8 or 16. */
	uint8_t accel_fs_g;
	/** 125, 250, 500, 1000 or 2000. */
	uint16_t gyro_fs_dps;
	/** Samples in a batch at most, 1 .. 16, and their time at most. */
	uint8_t batch_samples;
	uint16_t batch_ms;
	/** Rest after which the sensor goes to low power; 0 for never. */
	uint32_t rest_s;
	/** What still counts as rest. */
	uint16_t rest_dps;
	uint16_t rest_mg;
	/** Change between two samples at 52 Hz that ends it. */
	uint16_t wake_mg;
};

struct lsm6dsox_callbacks {
	/** Takes one batch, in the driver's thread; valid during the call. Required. */
	void (*on_batch)(const struct wire_imu_batch *batch);
	/** Something is wrong and a person should act. WIRE_FAULT_CODE_...; may be NULL. */
	void (*on_fault)(uint16_t code, uint32_t argument, const char *detail);
};

/** What devicetree and Kconfig ask for. */
void lsm6dsox_default_options(const struct device *dev, struct lsm6dsox_options *options);

/**
 * Start streaming. The sync timer must run.
 *
 * The sensor is set up in the driver's thread: what goes wrong there comes as a fault, and is
 * tried again until it works.
 *
 * @return 0; -ENODEV when the bus is not ready; -ENOMEM when no PPI, GPIOTE or capture channel is
 *         free; -EALREADY when streaming.
 */
int lsm6dsox_start(const struct device *dev, const struct lsm6dsox_options *options,
		   const struct lsm6dsox_callbacks *callbacks);

/** Stop streaming and power the sensor down; at most one more batch is delivered. */
void lsm6dsox_stop(const struct device *dev);

void lsm6dsox_get_stats(const struct device *dev, struct lsm6dsox_stats *stats);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_H_ */
