// Sections by the kinematic phase of a machine that paces itself: the angle of an output and its rate about a point
// inside their cycle (Ankarali & Cowan 2014, VI.B), where the data bear it.
#pragma once

#include "passages.hpp"

namespace saltus::rhythm {

// As find_passages, by turns of the phase instead of stays in charts; no events need be marked. Throws RecordError
// where no output goes round: its phase falls back within a cycle, or jumps at the events.
Passages find_turns(const Record& record, const RhythmOptions& o, Eigen::MatrixXd& noise, Eigen::VectorXd& count,
                    Rhythm& r);

}  // namespace saltus::rhythm
