/* SPDX-License-Identifier: Apache-2.0 */
#include "node.h"

#include <errno.h>

#include <zephyr/kernel.h>
#include <zephyr/sys/printk.h>
#include <zephyr/sys/reboot.h>

#include "calib.h"
#include "diag_csv.h"
#include "diag_report.h"
#include "diag_uart.h"
#include "fail.h"
#include "last_words.h"
#include "link_security.h"
#include "sync_timer.h"
#include "watchdog.h"

#define REPORT_PERIOD_MS 1000
/* HELLO comes with every second report. */
#define REPORTS_PER_HELLO 2U

/* A part that did not start. */
struct failure {
	uint16_t code;
	int error;
	const char *detail;
};

static struct failure failure;

static bool check(int error, uint16_t code, const char *detail)
{
	if (error == 0) {
		return true;
	}
	/* The first failure explains the ones after it. */
	if (failure.detail == NULL) {
		failure = (struct failure){.code = code, .error = error, .detail = detail};
	}
	return false;
}

static void report_failure(void)
{
	if (failure.detail != NULL) {
		diag_report_fault(failure.code, (uint32_t)failure.error, failure.detail);
	}
}

static void report_pulse(const struct sync_pulse_report *report)
{
	struct wire_pulse pulse = {
		.index = report->index,
		.scheduled_ticks_leader = report->scheduled_ticks_leader,
		.compare_ticks_node = report->compare_ticks_node,
		.captured_ticks_node = report->captured_ticks_node,
		.flags = (uint8_t)((report->late ? WIRE_PULSE_FLAG_LATE : 0) |
				   (report->captured ? WIRE_PULSE_FLAG_CAPTURED : 0)),
	};
	uint8_t payload[WIRE_PULSE_SIZE];

	diag_uart_frame(WIRE_PULSE_ID, payload, wire_pulse_put(payload, &pulse));
}

void node_send_batch(const struct wire_imu_batch *batch)
{
	uint8_t payload[WIRE_IMU_BATCH_MAX_SIZE];

	diag_uart_frame(WIRE_IMU_BATCH_ID, payload, wire_imu_batch_put(payload, batch));
}

void node_send_sync_state(const struct wire_sync_state *state)
{
	uint8_t payload[WIRE_SYNC_STATE_SIZE];

	diag_uart_frame(WIRE_SYNC_STATE_ID, payload, wire_sync_state_put(payload, state));
}

void node_send_sync_capture(const struct wire_sync_capture *capture)
{
	uint8_t payload[WIRE_SYNC_CAPTURE_SIZE];

	diag_uart_frame(WIRE_SYNC_CAPTURE_ID, payload, wire_sync_capture_put(payload, capture));
}

static void report_bad_payloads(uint32_t bad_payloads)
{
	static uint32_t reported;

	if (bad_payloads != reported) {
		reported = bad_payloads;
		diag_report_fault(WIRE_FAULT_CODE_LINK_BAD_PAYLOAD, bad_payloads,
				  "peer sent messages that were refused");
	}
}

static void report_link(const struct node_config *config)
{
	struct wire_link_stats stats = {.t_ticks_node = sync_timer_now_ticks()};
	struct sync_ppi_stats radio;
	uint8_t payload[WIRE_LINK_STATS_SIZE];

	sync_ppi_stats_get(&radio);
	stats.events = radio.events;
	stats.crc_errors = radio.crc_errors;
	link_stats_fill(&stats);
	config->fill_link_stats(&stats);
	diag_uart_frame(WIRE_LINK_STATS_ID, payload, wire_link_stats_put(payload, &stats));
	report_bad_payloads(stats.bad_payloads);
}

static int take_node_command(uint8_t command)
{
	if (command == WIRE_NODE_COMMAND_REBOOT) {
		diag_uart_close();
		sys_reboot(SYS_REBOOT_COLD);
	}
	return command >= WIRE_NODE_COMMAND_FAIL_FATAL ? fail_command(command)
						       : cal_command(command);
}

static int take_command(uint8_t type, const uint8_t *payload, size_t len)
{
	struct wire_imu_setup setup;
	struct wire_link_drop drop;
	struct wire_cal_record record;
	struct wire_node_command node;
	struct wire_link_key key;

	if (type == WIRE_IMU_SETUP_ID && wire_imu_setup_get(&setup, payload, len)) {
		return imu_source_setup(&setup);
	}
	if (type == WIRE_LINK_DROP_ID && wire_link_drop_get(&drop, payload, len)) {
		link_drop(drop.hold_ms);
		return 0;
	}
	if (type == WIRE_CAL_RECORD_ID && wire_cal_record_get(&record, payload, len)) {
		return cal_take_record(&record);
	}
	if (type == WIRE_NODE_COMMAND_ID && wire_node_command_get(&node, payload, len)) {
		return take_node_command(node.command);
	}
	if (type == WIRE_LINK_KEY_ID && wire_link_key_get(&key, payload, len)) {
		const int err = link_security_take_key(&key);

		if (!err) {
			link_drop(0);
		}
		return err;
	}
	return -EBADMSG;
}

/* In the system work queue. */
static void on_command(uint8_t type, const uint8_t *payload, size_t len)
{
	const int err = take_command(type, payload, len);

	if (err) {
		diag_report_fault(WIRE_FAULT_CODE_COMMAND_REFUSED, (uint32_t)-err,
				  "command of the host refused");
	}
}

static void say_hello(void)
{
	diag_report_hello();
	diag_csv_header();
	report_failure();
}

static void start(const struct node_config *config)
{
	const bool timed = check(sync_timer_init(), WIRE_FAULT_CODE_PPI_EXHAUSTED,
				 "sync timer did not start");

	/* In any case, so that what CAL status says is true. */
	cal_init(diag_report_device_id());
	(void)check(link_security_init(), WIRE_FAULT_CODE_CAL_STORE,
		    "link's key cannot be read: no peer");
	if (!timed) {
		return;
	}
	(void)check(sync_ppi_init(config->on_capture), WIRE_FAULT_CODE_PPI_EXHAUSTED,
		    "no PPI or GPIOTE channel for radio captures");
	(void)check(sync_pulse_start(config->clock, report_pulse), WIRE_FAULT_CODE_PPI_EXHAUSTED,
		    "no PPI or GPIOTE channel for pulses");
	(void)check(imu_source_start(config->on_batch), WIRE_FAULT_CODE_IMU_BUS,
		    "IMU did not start");
	(void)check(link_start(config->link), WIRE_FAULT_CODE_ASSERT, "Bluetooth did not start");
}

_Noreturn void node_run(const struct node_config *config)
{
	int64_t next_ms = k_uptime_get();
	int err = diag_uart_init(on_command);

	if (err) {
		printk("diagnostic UART did not open: %d\n", err);
	}
	/* First of all, so that a reader knows who speaks; before any other frame. */
	diag_report_hello();
	diag_csv_header();
	(void)check(watchdog_start(), WIRE_FAULT_CODE_WATCHDOG, "watchdog did not start");
	start(config);
	if (IS_ENABLED(CONFIG_BV_HEALTH)) {
		last_words_report();
	}
	report_failure();
	cal_report();
	for (uint32_t reports = 1;; reports++) {
		next_ms += REPORT_PERIOD_MS;
		k_sleep(K_TIMEOUT_ABS_MS(next_ms));
		watchdog_begin(WATCHDOG_MAIN);
		if (reports % REPORTS_PER_HELLO == 0U) {
			say_hello();
		}
		cal_report();
		diag_report_system();
		diag_report_thread();
		report_link(config);
		link_security_report();
		config->every_second();
		watchdog_end(WATCHDOG_MAIN);
	}
}
