/*
 * The brick around the generated program, for the test against the Python controller.
 *
 * Reads one request per tick from standard input, sets the device readings, runs the requested
 * tasks and writes their outputs to standard output. Both records are little-endian, naturally
 * aligned, and described in ballbot_ros/codegen/compiled_program.py.
 */
#include <string.h>
#include <unistd.h>

#include "kernel.h"
#include "kernel_id.h"
#include "ecrobot_interface.h"

#include "ballbot_controller.h"

#define MAX_DUE 8
#define MAX_TONES 2
#define NAME_LENGTH 16
#define PACKET_SIZE 32
#define STACK_WORDS 256U
#define STACK_PAINT 0xA5A5A5A5U

typedef struct {
    U32 systick_ms;
    S32 revolution[2];
    S32 sonar_reply_cm;
    U16 gyro[2];
    U16 battery_mv;
    U8 packet_comes;
    U8 stick[2];
    U8 due_count;
    U8 due[MAX_DUE];
} Request;

typedef struct {
    S8 duty[2];
    U8 faults;
    U8 logs;
    U8 tones;
    U8 pages;
    U8 sonar_reads;
    U16 stack[MAX_DUE];
    S8 data[2];
    S16 adc[4];
    U32 tone[MAX_TONES][3];
    char name[NAME_LENGTH];
    BallbotState state;
} Answer;

/* Faults: calls that are wrong for this robot. */
enum { WRONG_PORT = 1, WRONG_MODE = 2, WRONG_LENGTH = 4, TOO_MANY = 8, NO_TIMER = 16, NO_DEVICE = 32 };

const CounterType SysTimerCnt = 1;

static void (*const tasks[])(void) = {
#define ENTRY(name) TaskMain_##name,
    FOR_EACH_TASK(ENTRY)
};

static Request request;
static Answer answer;
static U8 packet[PACKET_SIZE];
static U8 packet_waits;
static U8 timer_signals;
static U8 sonar_on;
static U8 bluetooth_on;

static unsigned index_of(U8 port, U8 first)
{
    if (port != first && port != first + 1) {
        answer.faults |= WRONG_PORT;
        return 0;
    }
    return (unsigned)(port - first);
}

U16 ecrobot_get_gyro_sensor(U8 port)
{
    return request.gyro[index_of(port, NXT_PORT_S1)];
}

S32 ecrobot_get_motor_rev(U8 port)
{
    return request.revolution[index_of(port, NXT_PORT_B)];
}

void ecrobot_set_motor_mode_speed(U8 port, S32 mode, S8 speed)
{
    if (mode != 1) {
        answer.faults |= WRONG_MODE;
    }
    answer.duty[index_of(port, NXT_PORT_B)] = speed;
}

static void switch_sonar(U8 port, U8 on)
{
    if (port != NXT_PORT_S3) {
        answer.faults |= WRONG_PORT;
    }
    sonar_on = on;
}

void ecrobot_init_sonar_sensor(U8 port)
{
    switch_sonar(port, 1);
}

void ecrobot_term_sonar_sensor(U8 port)
{
    switch_sonar(port, 0);
}

S32 ecrobot_get_sonar_sensor(U8 port)
{
    if (port != NXT_PORT_S3) {
        answer.faults |= WRONG_PORT;
    }
    if (!sonar_on) {
        answer.faults |= NO_DEVICE;
    }
    answer.sonar_reads++;
    return request.sonar_reply_cm;
}

U16 ecrobot_get_battery_voltage(void)
{
    return request.battery_mv;
}

U32 ecrobot_get_systick_ms(void)
{
    return request.systick_ms;
}

void ecrobot_init_bt_slave(const CHAR *pin)
{
    bluetooth_on = pin[0] != '\0';
}

void ecrobot_term_bt_connection(void)
{
    bluetooth_on = 0;
}

U32 ecrobot_read_bt_packet(U8 *buffer, U32 length)
{
    if (length != PACKET_SIZE) {
        answer.faults |= WRONG_LENGTH;
        return 0;
    }
    if (!bluetooth_on) {
        answer.faults |= NO_DEVICE;
    }
    if (!packet_waits) {
        return 0;
    }
    memcpy(buffer, packet, PACKET_SIZE);
    packet_waits = 0;
    return PACKET_SIZE;
}

void ecrobot_bt_adc_data_logger(S8 data1, S8 data2, S16 adc1, S16 adc2, S16 adc3, S16 adc4)
{
    if (answer.logs++) {
        answer.faults |= TOO_MANY;
    }
    answer.data[0] = data1;
    answer.data[1] = data2;
    answer.adc[0] = adc1;
    answer.adc[1] = adc2;
    answer.adc[2] = adc3;
    answer.adc[3] = adc4;
}

SINT ecrobot_sound_tone(U32 frequency_hz, U32 duration_ms, U32 volume)
{
    if (answer.tones == MAX_TONES) {
        answer.faults |= TOO_MANY;
        return 0;
    }
    answer.tone[answer.tones][0] = frequency_hz;
    answer.tone[answer.tones][1] = duration_ms;
    answer.tone[answer.tones][2] = volume;
    answer.tones++;
    return 1;
}

void ecrobot_status_monitor(const CHAR *name)
{
    if (answer.pages++) {
        answer.faults |= TOO_MANY;
    }
    if (strlen(name) >= NAME_LENGTH) {
        answer.faults |= WRONG_LENGTH;
        return;
    }
    strcpy(answer.name, name);
}

StatusType SignalCounter(CounterType counter)
{
    timer_signals = (U8)(timer_signals + (counter == SysTimerCnt));
    return 0;
}

#ifdef __arm__

/* As on the brick, every task has its own stack, which is painted to measure its depth. */
static U32 stack[STACK_WORDS] __attribute__((aligned(8)));

void call_on_stack(void (*function)(void), void *top);

__asm__(".arm\n"
        ".align 2\n"
        ".global call_on_stack\n"
        ".type call_on_stack, %function\n"
        "call_on_stack:\n"
        "    push {r4, lr}\n"
        "    mov r4, sp\n"
        "    mov sp, r1\n"
        "    mov lr, pc\n"
        "    bx r0\n"
        ".global task_returned\n"
        "task_returned:\n"
        "    mov sp, r4\n"
        "    pop {r4, lr}\n"
        "    bx lr\n");

static void run(unsigned task)
{
    U32 unused = 0;
    U32 depth;

    for (depth = 0; depth < STACK_WORDS; depth++) {
        stack[depth] = STACK_PAINT;
    }
    call_on_stack(tasks[task], stack + STACK_WORDS);
    while (unused < STACK_WORDS && stack[unused] == STACK_PAINT) {
        unused++;
    }
    depth = (STACK_WORDS - unused) * sizeof(U32);
    if (depth > answer.stack[task]) {
        answer.stack[task] = (U16)depth;
    }
}

#else

static void run(unsigned task)
{
    tasks[task]();
}

#endif

static int receive(void *data, size_t size)
{
    U8 *at = data;

    while (size > 0) {
        const ssize_t got = read(STDIN_FILENO, at, size);
        if (got <= 0) {
            return 0;
        }
        at += got;
        size -= (size_t)got;
    }
    return 1;
}

static int deliver(const void *data, size_t size)
{
    const U8 *at = data;

    while (size > 0) {
        const ssize_t put = write(STDOUT_FILENO, at, size);
        if (put <= 0) {
            return 0;
        }
        at += put;
        size -= (size_t)put;
    }
    return 1;
}

static void tick(void)
{
    unsigned n;

    answer.logs = answer.tones = answer.pages = answer.sonar_reads = 0;
    timer_signals = 0;
    user_1ms_isr_type2();
    if (timer_signals != 1) {
        answer.faults |= NO_TIMER;
    }
    if (request.packet_comes) {
        memset(packet, 0, sizeof packet);
        memcpy(packet, request.stick, sizeof request.stick);
        packet_waits = 1;
    }
    for (n = 0; n < request.due_count; n++) {
        run(request.due[n]);
    }
    answer.state = ballbot;
}

int main(void)
{
    const U16 sizes[2] = {sizeof(Request), sizeof(Answer)};

    ecrobot_device_initialize();
    if (!deliver(sizes, sizeof sizes)) {
        return 1;
    }
    while (receive(&request, sizeof request)) {
        tick();
        if (!deliver(&answer, sizeof answer)) {
            return 1;
        }
    }
    ecrobot_device_terminate();
    return sonar_on || bluetooth_on || answer.duty[0] || answer.duty[1];
}
