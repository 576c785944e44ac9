/* SPDX-License-Identifier: Apache-2.0 */
#include "diag_report.h"

#include <stdbool.h>
#include <string.h>

#include <zephyr/kernel.h>
#include <zephyr/sys/util.h>

#include <hal/nrf_ficr.h>
#include <helpers/nrfx_reset_reason.h>

#include "diag_uart.h"
#include "sync_timer.h"

#define ROLE   (IS_ENABLED(CONFIG_BV_ROLE_LEADER) ? WIRE_ROLE_LEADER : WIRE_ROLE_FOLLOWER)
#define TARGET (IS_ENABLED(CONFIG_ARCH_POSIX) ? WIRE_TARGET_SIM : WIRE_TARGET_NRF52840DK)

#define CONN_INTERVAL_UNIT_US 1250U

static uint32_t reset_reason_once(void)
{
	static uint32_t reason;
	static bool read;

	if (!read) {
		read = true;
		reason = nrfx_reset_reason_get();
		/* The register accumulates until written. */
		nrfx_reset_reason_clear(reason);
	}
	return reason;
}

uint64_t diag_report_device_id(void)
{
	return ((uint64_t)nrf_ficr_deviceid_get(NRF_FICR, 1) << 32) |
	       nrf_ficr_deviceid_get(NRF_FICR, 0);
}

void diag_report_fill_hello(struct wire_hello *hello)
{
	*hello = (struct wire_hello){
		.protocol_version = WIRE_PROTOCOL_VERSION,
		.role = ROLE,
		.target = TARGET,
		.schema_hash = WIRE_SCHEMA_HASH,
		.build_id = BV_BUILD_ID,
		.device_id = diag_report_device_id(),
		.reset_reason = reset_reason_once(),
		.tick_rate_hz = WIRE_TICK_RATE_HZ,
		.conn_interval_us = CONFIG_BV_CONN_INTERVAL * CONN_INTERVAL_UNIT_US,
		.uptime_ms = k_uptime_get_32(),
	};
}

void diag_report_hello(void)
{
	struct wire_hello hello;
	uint8_t payload[WIRE_HELLO_SIZE];

	diag_report_fill_hello(&hello);
	diag_uart_frame(WIRE_HELLO_ID, payload, wire_hello_put(payload, &hello));
}

static uint16_t cpu_load_permille(void)
{
	static uint64_t last_all;
	static uint64_t last_idle;
	k_thread_runtime_stats_t stats;
	uint64_t all;
	uint64_t idle;

	if (k_thread_runtime_stats_all_get(&stats) != 0) {
		return 0;
	}
	/* execution_cycles counts the idle thread too. */
	all = stats.execution_cycles - last_all;
	idle = stats.idle_cycles - last_idle;
	last_all = stats.execution_cycles;
	last_idle = stats.idle_cycles;
	return all == 0U || idle > all ? 0U : (uint16_t)((all - idle) * 1000U / all);
}

static void take_smaller_headroom(const struct k_thread *thread, void *smallest)
{
	size_t free_b;

	if (k_thread_stack_space_get(thread, &free_b) == 0) {
		*(size_t *)smallest = MIN(*(size_t *)smallest, free_b);
	}
}

/* In simulation threads run on the host's stacks, and this is merely the smallest stack. */
static uint16_t stack_free_min_b(void)
{
	size_t smallest = UINT16_MAX;

	k_thread_foreach_unlocked(take_smaller_headroom, &smallest);
	return (uint16_t)smallest;
}

static void fill_heap(struct wire_system *system)
{
#if K_HEAP_MEM_POOL_SIZE > 0
	extern struct k_heap _system_heap;
	struct sys_memory_stats stats;

	if (sys_heap_runtime_stats_get(&_system_heap.heap, &stats) == 0) {
		system->heap_used_b = (uint32_t)stats.allocated_bytes;
		system->heap_peak_b = (uint32_t)stats.max_allocated_bytes;
	}
#else
	ARG_UNUSED(system);
#endif
}

void diag_report_system(void)
{
	struct wire_system system = {
		.t_ticks_node = sync_timer_now_ticks(),
		.cpu_load_permille = cpu_load_permille(),
		.stack_free_min_b = stack_free_min_b(),
		.uart_dropped = diag_uart_dropped(),
		.timer_wraps = sync_timer_wraps(),
	};
	uint8_t payload[WIRE_SYSTEM_SIZE];

	fill_heap(&system);
	diag_uart_frame(WIRE_SYSTEM_ID, payload, wire_system_put(payload, &system));
}

struct turn {
	uint32_t wanted;
	uint32_t at;
	struct wire_thread thread;
};

static void take_in_turn(const struct k_thread *thread, void *user)
{
	struct turn *turn = user;
	const char *name = k_thread_name_get((k_tid_t)thread);
	size_t free_b = 0;

	if (turn->at++ != turn->wanted || k_thread_stack_space_get(thread, &free_b) != 0) {
		return;
	}
	if (name != NULL) {
		memcpy(turn->thread.name, name, MIN(strlen(name), sizeof(turn->thread.name)));
	}
	turn->thread.stack_size_b = (uint32_t)thread->stack_info.size;
	turn->thread.stack_free_b = (uint32_t)free_b;
}

void diag_report_thread(void)
{
	static uint32_t next;
	struct turn turn = {.wanted = next, .thread.t_ticks_node = sync_timer_now_ticks()};
	uint8_t payload[WIRE_THREAD_SIZE];

	k_thread_foreach_unlocked(take_in_turn, &turn);
	next = next + 1U < turn.at ? next + 1U : 0U;
	if (turn.thread.stack_size_b > 0U) {
		diag_uart_frame(WIRE_THREAD_ID, payload, wire_thread_put(payload, &turn.thread));
	}
}

void diag_report_fault(uint16_t code, uint32_t argument, const char *detail)
{
	struct wire_fault fault = {
		.t_ticks_node = sync_timer_now_ticks(),
		.code = code,
		.argument = argument,
	};
	uint8_t payload[WIRE_FAULT_SIZE];

	memcpy(fault.detail, detail, MIN(strlen(detail), sizeof(fault.detail)));
	diag_uart_frame(WIRE_FAULT_ID, payload, wire_fault_put(payload, &fault));
}
