# The model and effect that README.md shows are, to the letter, those that the consumer compiles.
file(READ ${ROOT}/README.md readme)
file(READ ${ROOT}/tests/consumer/ball.hpp example)
string(STRIP "${example}" example)
string(FIND "${readme}" "```cpp\n${example}\n```" at)
if(at EQUAL -1)
  message(FATAL_ERROR "README.md does not show tests/consumer/ball.hpp as it is: copy the file into the first ```cpp block")
endif()
