/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * From FIFO bursts and interrupt edges to batches with hardware times. Pure C11: the driver brings
 * words and times, and takes batches.
 *
 * One service of the FIFO is a sequence of calls:
 *
 *     gap (only after words may have been lost), edge (when one was captured), words (once per
 *     burst), end
 *
 * How an edge gets its sample: INT1 rises when the FIFO reaches its watermark of W words. As no
 * word was read since, the word that raised it is the W-th from the front of the FIFO at that
 * moment, which is the W-th word read after it. The instant of that word's slot is the instant of
 * the edge, less the chip's latency.
 *
 * How slots lost without a trace get counted: the slot counter gives numbers modulo four. After a
 * gap the slot that must have been the newest at the time of the status read gives the rest: the
 * estimate of slot times is far better than the two periods that this needs.
 */
#ifndef BV_LSM6DSOX_STREAM_H_
#define BV_LSM6DSOX_STREAM_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "lsm6dsox_decoder.h"
#include "lsm6dsox_rest.h"
#include "lsm6dsox_timing.h"
#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Words that the FIFO holds. */
#define LSM6DSOX_FIFO_WORDS 512U

/** Pairs of a full FIFO, what is left from the burst before, and the decoder's spare. */
#define LSM6DSOX_STREAM_PAIRS (LSM6DSOX_FIFO_WORDS / 2U + WIRE_IMU_BATCH_MAX_COUNT + 4U)

struct lsm6dsox_stream_params {
	/** Rate by the datasheet and the chip's trim. */
	float nominal_rate_hz;
	struct lsm6dsox_timing_params timing;
	/** From a slot's instant to the edge it raises. */
	uint32_t edge_latency_ticks;
	uint16_t watermark_words;
	/** Samples in a batch, 1 .. WIRE_IMU_BATCH_MAX_COUNT. */
	uint8_t batch_samples;
	/** Slots to be dropped after the sensors were switched on. */
	uint32_t settling_slots;
	uint8_t accel_fs_g;
	uint16_t gyro_fs_dps;
	struct lsm6dsox_rest rest;
	void *context;
	/** Takes one batch; everything is filled in but `source`. */
	void (*on_batch)(void *context, const struct wire_imu_batch *batch);
};

struct lsm6dsox_stream_counters {
	/** Pairs delivered, and the CRC-32 over them: gyro xyz, accel xyz, little-endian i16. */
	uint32_t samples;
	uint32_t samples_crc32;
	/** Pairs dropped because a sensor or the timing had not settled. */
	uint32_t pairs_unsettled;
	/** Slots found lost by time where the slot counter was silent. */
	uint32_t slots_resolved_by_time;
};

/** State; the members are public so that a test can set and read them. */
struct lsm6dsox_stream {
	struct lsm6dsox_stream_params params;
	struct lsm6dsox_stream_counters counters;
	struct lsm6dsox_decoder decoder;
	struct lsm6dsox_timing timing;

	/** Pairs decoded and not yet delivered. */
	struct lsm6dsox_pair pairs[LSM6DSOX_STREAM_PAIRS];
	size_t count;

	/** Words still to come before the one that raised the edge; 0 when there is no edge. */
	size_t words_to_mark;
	uint64_t edge_ticks;
	uint32_t mark_slot;
	bool mark_found;

	/** Words may have been lost before this service's words. */
	bool gap;
	/** The chip said so. */
	bool overrun;
	/** Sensors or timing have not settled since the chip was set up. */
	bool settling;
	/** Slots dropped for that so far, and how many have to be in any case. */
	uint32_t settling_slots;
	uint32_t settling_slots_min;
	/** The index goes on without a hole although slots passed. */
	bool rebase;
	/** Slot minus sample index. */
	uint32_t index_base;
	/** Slot after the last one delivered. */
	uint32_t next_slot;
	/** Enough calm samples in a row. */
	bool resting;
	int16_t temperature_cdegc;
};

void lsm6dsox_stream_init(struct lsm6dsox_stream *stream,
			  const struct lsm6dsox_stream_params *params);

/**
 * The chip was set up anew: its samples start again, at an unknown phase.
 *
 * @param now_ticks node's clock.
 * @param count_missing whether samples were missed since the last ones, so that the index must
 *        show a hole. False after a rest.
 */
void lsm6dsox_stream_restarted(struct lsm6dsox_stream *stream, uint64_t now_ticks,
			       bool count_missing);

/** The nominal rate turned out to be another. Before the first words only. */
void lsm6dsox_stream_set_rate(struct lsm6dsox_stream *stream, float nominal_rate_hz);

/** Words may have been lost since the last ones. @p overrun when the chip says so. */
void lsm6dsox_stream_gap(struct lsm6dsox_stream *stream, bool overrun);

/** INT1 rose at @p edge_ticks and no word was read since. */
void lsm6dsox_stream_edge(struct lsm6dsox_stream *stream, uint64_t edge_ticks);

/** One burst. @p size at most LSM6DSOX_FIFO_WORDS words between two calls of end. */
void lsm6dsox_stream_words(struct lsm6dsox_stream *stream, const uint8_t *words, size_t size);

/**
 * All words that were in the FIFO at @p status_ticks have been given: deliver.
 *
 * @param polled no edge has come for so long that the time of the status must do.
 */
void lsm6dsox_stream_end(struct lsm6dsox_stream *stream, uint64_t status_ticks, bool polled);

/** Deliver what is left, in a shorter batch. */
void lsm6dsox_stream_flush(struct lsm6dsox_stream *stream);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_STREAM_H_ */
