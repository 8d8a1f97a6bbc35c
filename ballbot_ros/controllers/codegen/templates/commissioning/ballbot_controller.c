/*
 * The commissioning program: task_init, task_ts1. It measures gyros and motors; it does not balance.
 *
 * {{ stamp }}
 *
 * All arithmetic is on integers.
 */
#include "kernel.h"
#include "kernel_id.h"
#include "ecrobot_interface.h"

#include "ballbot_controller.h"
#include "ballbot_parameters.h"

#define GYRO_X NXT_PORT_S1
#define GYRO_Y NXT_PORT_S2
#define MOTOR_X NXT_PORT_B
#define MOTOR_Y NXT_PORT_C
#define BRAKE 1

/* Values of phase that differ from rest. */
#define PORTS {{ commissioning.PORTS }}U
#define RAMP {{ commissioning.RAMP }}U
#define PLAY {{ commissioning.PLAY }}U
#define TILT {{ commissioning.TILT }}U
#define END {{ commissioning.END }}U

#define MAX_DUTY {{ commissioning.MAX_DUTY }}
#define LOG_TICKS {{ commissioning.LOG_TICKS }}U
#define TONE_HZ {{ commissioning.TONE_HZ }}U
#define TONE_MS {{ commissioning.TONE_MS }}U
#define END_TONE_MS {{ commissioning.END_TONE_MS }}U
#define VOLUME {{ commissioning.VOLUME }}U
#define PACKET_SIZE {{ packet_size }}U

/*
 * No initializer: STOP and RUN restart the program without reloading its data. task_init sets
 * every member.
 */
BallbotState ballbot;

/* Returns the duty of a step of the ramp: 0 ... 100 ... -100 ... 0 %. */
static S8 ramp_duty(U32 step)
{
    const S32 up = (S32)step;
    S32 duty = up;

    if (up > (3 * MAX_DUTY)) {
        duty = up - (4 * MAX_DUTY);
    } else if (up > MAX_DUTY) {
        duty = (2 * MAX_DUTY) - up;
    } else {
        /* Rises from 0. */
    }
    return (S8)duty;
}

/* Returns the duty of a pulse for the gear play: + + - -, each with a pause, then 1 % stronger. */
static S8 play_pulse(U32 part)
{
    const U32 stronger = part / 8U;
    S32 duty = 0;

    if ((part % 2U) == 0U) {
        duty = (S32)play_duty + (S32)stronger;
        if (duty > MAX_DUTY) {
            duty = MAX_DUTY;
        }
        if ((part % 8U) >= 4U) {
            duty = -duty;
        }
    }
    return (S8)duty;
}

/* Duties of both motors in a tick of a phase. */
static void command(U8 phase, U32 ticks, S8 *duty_x, S8 *duty_y)
{
    *duty_x = 0;
    *duty_y = 0;
    if (phase == PORTS) {
        const U32 part = ticks / port_ticks;

        if (part == 0U) {
            *duty_x = port_duty;
        } else if (part == 2U) {
            *duty_y = port_duty;
        } else {
            /* A pause. */
        }
    } else if (phase == RAMP) {
        *duty_x = ramp_duty(ticks / step_ticks);
        *duty_y = *duty_x;
    } else if (phase == PLAY) {
        *duty_x = play_pulse(ticks / play_ticks);
        *duty_y = *duty_x;
    } else {
        /* The motors brake. */
    }
}

/* Sounds a tone at the beginning of a phase, and of the second tilt. */
static void sound(U8 phase, U32 ticks)
{
    if ((ticks == 0U) || ((phase == TILT) && (ticks == tilt_ticks))) {
        U32 duration = TONE_MS;

        if (phase == END) {
            duration = END_TONE_MS;
        }
        (void)ecrobot_sound_tone(TONE_HZ, duration, VOLUME);
    }
}

/* Returns the reading of a gyro, limited to 16 bits with a sign. */
static S16 logged_gyro(U8 port)
{
    const U16 gyro = ecrobot_get_gyro_sensor(port);

    return (gyro > 32767U) ? (S16)32767 : (S16)gyro;
}

/* Once, at each start: set all initial values. */
TASK(task_init)
{
{% for variable in variables %}
    ballbot.{{ variable.name }} = {{ variable.initial }};
{% endfor %}
    TerminateTask();
}

/* Every {{ periods.task_ts1 }} ms: the duties of the phase, its tones, and a log packet every {{ commissioning.LOG_TICKS }} ticks. */
TASK(task_ts1)
{
    U8 packet[PACKET_SIZE];
    S8 duty_x;
    S8 duty_y;

    /* Nothing is driven, but packets that nobody takes would fill the buffer. */
    (void)ecrobot_read_bt_packet(packet, PACKET_SIZE);
    if ((ballbot.phase < END) && (ballbot.ticks >= phase_ticks[ballbot.phase])) {
        ballbot.phase = (U8)((ballbot.phase + 1U) & 0xFFU);
        ballbot.ticks = 0U;
    }
    command(ballbot.phase, ballbot.ticks, &duty_x, &duty_y);
    ecrobot_set_motor_mode_speed(MOTOR_X, BRAKE, duty_x);
    ecrobot_set_motor_mode_speed(MOTOR_Y, BRAKE, duty_y);
    sound(ballbot.phase, ballbot.ticks);
    if (ballbot.log_counter == 0U) {
        ecrobot_bt_adc_data_logger(duty_x, duty_y, (S16)ballbot.phase, 0, logged_gyro(GYRO_X),
                                   logged_gyro(GYRO_Y));
    }
    ballbot.ticks++;
    ballbot.log_counter = (U8)((ballbot.log_counter + 1U) % LOG_TICKS);
    TerminateTask();
}
