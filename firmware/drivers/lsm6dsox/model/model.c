/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ties the chip to the simulator: its clock, the GPIO model, options and files.
 *
 * The simulator knows whole microseconds of the node's local time. A sample falls on the nearest
 * one, so what the node captures is off by at most half a microsecond, evenly to both sides.
 */
#include "model.h"

#include "bs_cmd_line.h"
#include "bs_dynargs.h"
#include "bs_tracing.h"
#include "bs_types.h"
#include "nsi_hw_scheduler.h"
#include "nsi_hws_models_if.h"
#include "nsi_tasks.h"

#include "NRF_GPIO.h"
#include "xo_if.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "chip.h"
#include "fault.h"
#include "hands.h"
#include "motion.h"

#define OVERRUN_WORDS       64
#define WORDS_PER_SLOT      2
#define DEFAULT_BIT_ERRORS  1e-5
#define MAX_SPI_HZ          10000000U
#define TRUTH_RECORD_SIZE   40
#define ADDRESS_WHO_AM_I    0x8F
#define DEFAULT_GYRO_ON_US  70000.0
#define DEFAULT_ACCEL_ON_US 20000.0

static struct {
	struct chip *chip;
	struct motion *motion;
	struct hands *hands;
	struct faults faults;
	double faults_from_s;
	struct lsm6dsox_model_slot history[LSM6DSOX_MODEL_HISTORY];
	uint32_t run;
	struct chip_motion held;
	bool is_held;
	FILE *truth;
	FILE *edges;

	bool attached;
	unsigned int port;
	unsigned int pin;

	bool int1;            /* What the chip drives */
	bool int1_suppressed; /* This assertion does not reach the pin */
	bool pin_level;
	uint64_t edges_dropped;
	uint64_t stalls;
	uint64_t bits_flipped;
	double stall_next_s;

	uint8_t address_byte; /* Of the transfer under way */
	size_t at;            /* Bytes of it so far */

	uint64_t random;
	double noise_accel_mps2;
	double noise_gyro_radps;
} model;

static bs_time_t sample_timer = TIME_NEVER;

static struct {
	char *motion;
	char *hands;
	char *truth;
	char *edges;
	char *stats;
	char *fault;
	char *noise;
	bool pattern;
	bool lenient;
	uint32_t seed;
	double rate_error;
	double rate_drift;
	double temperature;
	double temperature_ramp;
} option;

static double given(double value, double otherwise)
{
	/* Options that were not given are set to NAN. */
	return isnan(value) ? otherwise : value;
}

/* --- time ------------------------------------------------------------------------------------ */

static long double local_us_of(long double true_us)
{
	return 1e6L * dev_time_from_phy(true_us * 1e-6L);
}

static long double true_us_of(long double local_us)
{
	return 1e6L * phy_time_from_dev(local_us * 1e-6L);
}

static double now_true_s(void)
{
	return (double)(true_us_of((long double)nsi_hws_get_time()) * 1e-6L);
}

static const struct fault *active_fault(enum fault_kind kind)
{
	return faults_active(&model.faults, kind, now_true_s() - model.faults_from_s);
}

/* --- chance ---------------------------------------------------------------------------------- */

/* xorshift64*: Vigna, "An experimental exploration of Marsaglia's xorshift generators", 2016. */
static double random_unit(void)
{
	model.random ^= model.random >> 12;
	model.random ^= model.random << 25;
	model.random ^= model.random >> 27;
	return (double)((model.random * UINT64_C(0x2545F4914F6CDD1D)) >> 11) * 0x1p-53;
}

static double random_normal(void)
{
	/* Box-Muller; 1 - u is never 0. */
	return sqrt(-2.0 * log(1.0 - random_unit())) * cos(2.0 * M_PI * random_unit());
}

/* --- what the chip asks for ------------------------------------------------------------------ */

static void ask_hands(double t_s, struct chip_motion *at)
{
	const char *bad = hands_at(model.hands, t_s, at);

	if (bad != NULL) {
		bs_trace_error_time_line("-imu_hands=%s: not seven numbers: %s\n", option.hands,
					 bad);
	}
}

static void motion_now(void *context, long double t_us_true, struct chip_motion *at)
{
	(void)context;
	if (model.is_held) {
		*at = model.held;
	} else if (model.hands != NULL) {
		ask_hands((double)(t_us_true * 1e-6L), at);
	} else if (model.motion != NULL) {
		motion_at(model.motion, (double)(t_us_true * 1e-6L), at);
	}
	for (int i = 0; i < 3; i++) {
		if (model.noise_accel_mps2 > 0.0) {
			at->accel_mps2[i] += model.noise_accel_mps2 * random_normal();
		}
		if (model.noise_gyro_radps > 0.0) {
			at->gyro_radps[i] += model.noise_gyro_radps * random_normal();
		}
	}
}

static void put_le(uint8_t *out, uint64_t value, size_t size)
{
	for (size_t i = 0; i < size; i++) {
		out[i] = (uint8_t)(value >> 8 * i);
	}
}

static void put_f64(uint8_t *out, double value)
{
	uint64_t raw;

	memcpy(&raw, &value, sizeof(raw));
	put_le(out, raw, sizeof(raw));
}

static void slot_taken(void *context, const struct chip_slot *slot)
{
	struct lsm6dsox_model_slot *remembered =
		&model.history[slot->slot % LSM6DSOX_MODEL_HISTORY];
	uint8_t record[TRUTH_RECORD_SIZE];

	(void)context;
	remembered->run = slot->run;
	remembered->slot = slot->slot;
	remembered->t_us_local = (double)local_us_of(slot->t_us_true);
	memcpy(remembered->gyro_lsb, slot->gyro_lsb, sizeof(remembered->gyro_lsb));
	memcpy(remembered->accel_lsb, slot->accel_lsb, sizeof(remembered->accel_lsb));
	remembered->flags = slot->flags;
	model.run = slot->run;
	if (model.truth == NULL) {
		return;
	}
	put_le(record, slot->run, 4);
	put_le(record + 4, slot->slot, 4);
	put_f64(record + 8, (double)slot->t_us_true);
	put_f64(record + 16, remembered->t_us_local);
	for (size_t i = 0; i < 3; i++) {
		put_le(record + 24 + 2 * i, (uint16_t)slot->gyro_lsb[i], 2);
		put_le(record + 30 + 2 * i, (uint16_t)slot->accel_lsb[i], 2);
	}
	record[36] = slot->accel_fs_g;
	record[37] = slot->flags;
	put_le(record + 38, slot->gyro_fs_dps, 2);
	if (fwrite(record, sizeof(record), 1, model.truth) != 1) {
		bs_trace_error_line("-imu_truth=%s: %s\n", option.truth, strerror(errno));
	}
}

static void forbidden(void *context, const char *text)
{
	(void)context;
	if (option.lenient) {
		bs_trace_warning_time_line("LSM6DSOX: %s\n", text);
	} else {
		bs_trace_error_time_line("LSM6DSOX: %s\n", text);
	}
}

/* --- keeping the simulator and the chip in step ---------------------------------------------- */

static void drive_pin(void)
{
	const bool int1 = chip_int1(model.chip);
	bool level;

	if (int1 && !model.int1) {
		const struct fault *fault = active_fault(FAULT_DROPPED_EDGE);

		model.int1_suppressed = fault != NULL && random_unit() < fault_rate(fault, 1.0);
		model.edges_dropped += model.int1_suppressed ? 1 : 0;
	}
	model.int1 = int1;
	level = int1 && !model.int1_suppressed &&
		active_fault(FAULT_MISSING_INT) == NULL;
	if (!model.attached || level == model.pin_level) {
		return;
	}
	model.pin_level = level;
	if (model.edges != NULL) {
		fprintf(model.edges, "%llu,%u,%u,%d\n", (unsigned long long)nsi_hws_get_time(),
			model.port, model.pin, level);
	}
	nrf_gpio_test_change_pin_level(model.port, model.pin, level);
}

static void advance(void)
{
	/* Half a microsecond ahead: a sample falls on the nearest whole one. */
	chip_advance(model.chip, true_us_of((long double)nsi_hws_get_time() + 0.5L));
	drive_pin();
}

static void plan_next(void)
{
	const long double next_us = chip_next_us(model.chip);

	if (isinf(next_us)) {
		sample_timer = TIME_NEVER;
	} else {
		const bs_time_t at = (bs_time_t)(local_us_of(next_us) + 0.5L);

		sample_timer = at > nsi_hws_get_time() ? at : nsi_hws_get_time() + 1;
	}
	nsi_hws_find_next_event();
}

static void sample_due(void)
{
	advance();
	plan_next();
}

NSI_HW_EVENT(sample_timer, sample_due, 100);

void lsm6dsox_model_attach(unsigned int int1_port, unsigned int int1_pin, uint32_t spi_hz)
{
	model.port = int1_port;
	model.pin = int1_pin;
	model.attached = true;
	if (spi_hz > MAX_SPI_HZ) {
		bs_trace_error_line("LSM6DSOX: SPI clock of %u Hz, at most %u are allowed\n",
				    spi_hz, MAX_SPI_HZ);
	}
}

uint32_t lsm6dsox_model_stall_ms(void)
{
	const double now_s = now_true_s();
	const struct fault *fault = active_fault(FAULT_OVERRUN);
	const double slots = (double)(CHIP_FIFO_WORDS + OVERRUN_WORDS) / WORDS_PER_SLOT;
	const double rate_hz = chip_slot_rate_hz(model.chip);

	/* Before the chip samples there is nothing to overrun. */
	if (fault == NULL || now_s < model.stall_next_s || rate_hz == 0.0) {
		return 0;
	}
	model.stalls++;
	model.stall_next_s = isnan(fault->rate) ? INFINITY : now_s + 1.0 / fault->rate;
	return (uint32_t)ceil(1e3 * slots / (rate_hz * (1.0 + given(option.rate_error, 0.0))));
}

static uint8_t with_bit_errors(uint8_t byte, double probability)
{
	for (unsigned int bit = 0; bit < 8; bit++) {
		if (random_unit() < probability) {
			byte ^= (uint8_t)(1U << bit);
			model.bits_flipped++;
		}
	}
	return byte;
}

void lsm6dsox_model_transfer(const uint8_t *mosi, uint8_t *miso, size_t size, bool first,
			     bool last)
{
	const struct fault *stuck = active_fault(FAULT_STUCK_BUS);
	const struct fault *wrong_id = active_fault(FAULT_WRONG_WHO_AM_I);
	const struct fault *flips = active_fault(FAULT_BIT_ERRORS);

	if (stuck != NULL) {
		memset(miso, fault_rate(stuck, 1.0) != 0.0 ? 0xFF : 0x00, size);
		return;
	}
	advance();
	if (first) {
		chip_select(model.chip);
		model.at = 0;
	}
	for (size_t i = 0; i < size; i++) {
		if (model.at == 0) {
			model.address_byte = mosi[i];
		}
		miso[i] = chip_exchange(model.chip, mosi[i]);
		if (wrong_id != NULL && model.at == 1 && model.address_byte == ADDRESS_WHO_AM_I) {
			miso[i] = (uint8_t)fault_rate(wrong_id, 0x6A);
		}
		if (flips != NULL) {
			miso[i] = with_bit_errors(miso[i], fault_rate(flips, DEFAULT_BIT_ERRORS));
		}
		model.at++;
	}
	if (last) {
		chip_deselect(model.chip);
	}
	drive_pin();
	plan_next();
}

/* --- tests inside the image ------------------------------------------------------------------ */

bool lsm6dsox_model_truth(uint32_t slot, struct lsm6dsox_model_slot *truth)
{
	*truth = model.history[slot % LSM6DSOX_MODEL_HISTORY];
	return truth->run == model.run && truth->slot == slot && model.run != 0;
}

uint64_t lsm6dsox_model_now_us(void)
{
	return nsi_hws_get_time();
}

void lsm6dsox_model_power_cycle(void)
{
	advance();
	chip_power_cycle(model.chip);
	drive_pin();
	plan_next();
}

void lsm6dsox_model_set_clock(double rate_error, double drift_per_s)
{
	advance();
	option.rate_error = rate_error;
	chip_set_clock(model.chip, rate_error, drift_per_s);
}

void lsm6dsox_model_set_faults(const char *faults)
{
	const char *wrong = NULL;

	model.faults.count = 0;
	model.faults_from_s = now_true_s();
	model.stall_next_s = 0.0;
	if (faults != NULL) {
		wrong = faults_parse(&model.faults, faults);
	}
	if (wrong != NULL) {
		bs_trace_error_line("%s\n", wrong);
	}
	drive_pin();
}

void lsm6dsox_model_set_pattern(bool pattern)
{
	chip_set_pattern(model.chip, pattern);
}

void lsm6dsox_model_set_motion(const double accel_mps2[3], const double gyro_radps[3])
{
	memcpy(model.held.accel_mps2, accel_mps2, sizeof(model.held.accel_mps2));
	memcpy(model.held.gyro_radps, gyro_radps, sizeof(model.held.gyro_radps));
	model.is_held = true;
}

uint32_t lsm6dsox_model_set_strict(bool strict)
{
	option.lenient = !strict;
	return chip_get_stats(model.chip)->violations;
}

/* --- options, start, end --------------------------------------------------------------------- */

static void fault_found(char *argv, int offset)
{
	const char *wrong = faults_parse(&model.faults, option.fault);

	(void)offset;
	if (wrong != NULL) {
		bs_trace_error_line("%s: %s\n", argv, wrong);
	}
}

static void register_options(void)
{
	static bs_args_struct_t options[] = {
		{.option = "imu_motion", .name = "file", .type = 's', .dest = &option.motion,
		 .descript = "LSM6DSOX: motion to play"},
		{.option = "imu_hands", .name = "pipe", .type = 's', .dest = &option.hands,
		 .descript = "LSM6DSOX: held and turned by whoever writes to this pipe"},
		{.is_switch = true, .option = "imu_pattern", .type = 'b', .dest = &option.pattern,
		 .descript = "LSM6DSOX: samples carry their slot number instead of motion"},
		{.option = "imu_noise", .name = "A:G", .type = 's', .dest = &option.noise,
		 .descript = "LSM6DSOX: noise of each sample, m/s^2 and rad/s rms"},
		{.option = "imu_seed", .name = "N", .type = 'u', .dest = &option.seed,
		 .descript = "LSM6DSOX: seed of noise and random faults"},
		{.option = "imu_rate_error", .name = "E", .type = 'f', .dest = &option.rate_error,
		 .descript = "LSM6DSOX: relative error of the chip's clock"},
		{.option = "imu_rate_drift", .name = "D", .type = 'f', .dest = &option.rate_drift,
		 .descript = "LSM6DSOX: growth of that error per second"},
		{.option = "imu_temperature", .name = "T", .type = 'f',
		 .dest = &option.temperature, .descript = "LSM6DSOX: die temperature, deg C"},
		{.option = "imu_temperature_ramp", .name = "R", .type = 'f',
		 .dest = &option.temperature_ramp,
		 .descript = "LSM6DSOX: growth of the temperature, deg C per second"},
		{.option = "imu_fault", .name = "KIND[:START[:DURATION[:RATE]]]", .type = 's',
		 .dest = &option.fault, .call_when_found = fault_found,
		 .descript = "LSM6DSOX: a fault; see model/fault.h; may be repeated"},
		{.is_switch = true, .option = "imu_lenient", .type = 'b', .dest = &option.lenient,
		 .descript = "LSM6DSOX: a forbidden access does not end the run"},
		{.option = "imu_truth", .name = "file", .type = 's', .dest = &option.truth,
		 .descript = "LSM6DSOX: write what was sampled and when"},
		{.option = "imu_edges", .name = "file", .type = 's', .dest = &option.edges,
		 .descript = "LSM6DSOX: write the changes of the INT1 pin"},
		{.option = "imu_stats", .name = "file", .type = 's', .dest = &option.stats,
		 .descript = "LSM6DSOX: write the counts of the run at its end"},
		ARG_TABLE_ENDMARKER,
	};

	bs_add_extra_dynargs(options);
}

NSI_TASK(register_options, PRE_BOOT_1, 200);

static FILE *open_output(const char *option_name, const char *path)
{
	FILE *file = fopen(path, "wb");

	if (file == NULL) {
		bs_trace_error_line("-%s=%s: %s\n", option_name, path, strerror(errno));
	}
	return file;
}

static void read_noise(void)
{
	if (option.noise != NULL &&
	    sscanf(option.noise, "%lf:%lf", &model.noise_accel_mps2, &model.noise_gyro_radps) !=
		    2) {
		bs_trace_error_line("-imu_noise=%s: two numbers with ':' between are needed\n",
				    option.noise);
	}
}

static void read_motion(void)
{
	char problem[256];

	if (option.motion == NULL) {
		return;
	}
	model.motion = motion_load(option.motion, problem, sizeof(problem));
	if (model.motion == NULL) {
		bs_trace_error_line("-imu_motion=%s: %s\n", option.motion, problem);
	}
}

static void take_hands(void)
{
	static const struct chip_motion flat = {.accel_mps2 = {0.0, 0.0, 9.80665}};
	char problem[256];

	if (option.hands == NULL) {
		return;
	}
	model.hands = hands_open(option.hands, &flat, problem, sizeof(problem));
	if (model.hands == NULL) {
		bs_trace_error_line("-imu_hands=%s: %s\n", option.hands, problem);
	}
}

static void open_files(void)
{
	uint8_t header[16] = "BVIMUTRU";

	if (option.truth != NULL) {
		model.truth = open_output("imu_truth", option.truth);
		put_le(header + 8, 1, 4);
		put_le(header + 12, TRUTH_RECORD_SIZE, 4);
		(void)fwrite(header, sizeof(header), 1, model.truth);
	}
	if (option.edges != NULL) {
		model.edges = open_output("imu_edges", option.edges);
		fprintf(model.edges, "time(microsecond),port,pin,level\n");
	}
}

static void model_init(void)
{
	struct chip_config config = {
		.rate_error = given(option.rate_error, 0.0),
		.rate_drift_per_s = given(option.rate_drift, 0.0),
		.temperature_degc = given(option.temperature, 25.0),
		.temperature_ramp_degc_per_s = given(option.temperature_ramp, 0.0),
		.gyro_turn_on_us = DEFAULT_GYRO_ON_US,
		.accel_turn_on_us = DEFAULT_ACCEL_ON_US,
		.pattern = option.pattern,
		.motion = motion_now,
		.slot = slot_taken,
		.violation = forbidden,
	};

	/* Any odd number will do; the seed only has to make a difference. */
	model.random = UINT64_C(0x9E3779B97F4A7C15) ^ ((uint64_t)option.seed << 1);
	read_noise();
	read_motion();
	take_hands();
	open_files();
	model.chip = chip_new(&config);
	if (model.chip == NULL) {
		bs_trace_error_line("LSM6DSOX: no memory for the model\n");
	}
	chip_advance(model.chip, true_us_of(0.0L));
}

NSI_TASK(model_init, HW_INIT, 200);

static void write_stats(void)
{
	const struct chip_stats *s = chip_get_stats(model.chip);
	FILE *file = open_output("imu_stats", option.stats);

	fprintf(file,
		"{\"slots\": %llu, \"words_written\": %llu, \"words_read\": %llu, "
		"\"words_overwritten\": %llu, \"words_flushed\": %llu, \"words_empty\": %llu, "
		"\"words_left\": %llu, \"violations\": %u, \"stalls\": %llu, "
		"\"edges_dropped\": %llu, \"bits_flipped\": %llu}\n",
		(unsigned long long)s->slots, (unsigned long long)s->words_written,
		(unsigned long long)s->words_read, (unsigned long long)s->words_overwritten,
		(unsigned long long)s->words_flushed, (unsigned long long)s->words_empty,
		(unsigned long long)chip_level(model.chip), s->violations,
		(unsigned long long)model.stalls,
		(unsigned long long)model.edges_dropped, (unsigned long long)model.bits_flipped);
	fclose(file);
}

static void model_end(void)
{
	if (model.chip != NULL && option.stats != NULL) {
		write_stats();
	}
	if (model.truth != NULL) {
		fclose(model.truth);
	}
	if (model.edges != NULL) {
		fclose(model.edges);
	}
	chip_free(model.chip);
	model.chip = NULL;
	motion_free(model.motion);
	model.motion = NULL;
	hands_close(model.hands);
	model.hands = NULL;
}

NSI_TASK(model_end, ON_EXIT_PRE, 200);
