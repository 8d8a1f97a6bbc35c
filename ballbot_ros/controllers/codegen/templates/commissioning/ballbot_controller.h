/*
 * Shared data of the commissioning program.
 *
 * {{ stamp }}
 */
#ifndef BALLBOT_CONTROLLER_H
#define BALLBOT_CONTROLLER_H

#include "ecrobot_interface.h"

/* Units and meanings are in DATA_DICTIONARY.md. */
typedef struct {
{% for variable in variables %}
    {{ variable.c_type }} {{ variable.name }};
{% endfor %}
} BallbotState;

extern BallbotState ballbot;

#endif
