// The picture of a map as a whole: the order in which all is drawn.
function drawChosen(chosen, width) {
  if (!chosen) return;
  for (const [color, size] of [["rgba(255,255,255,.95)", width + 2.5], ["#0b0f14", width]]) {
    pen.beginPath();
    for (const lane of chosen.outline || chosen.lanes || []) ring(lane);
    for (const line of chosen.rings || []) { trace(line); pen.closePath(); }
    pen.strokeStyle = color; pen.lineWidth = size; pen.stroke();
  }
}

function draw() {
  const dots = window.devicePixelRatio || 1;
  pen.setTransform(dots, 0, 0, dots, 0, 0);
  const bounds = window_(4), shown = new Set(LANES.filter(lane => meets(lane.box, bounds)));
  drawGround(bounds, shown);
  if (across() > 2) drawReference(bounds);
  drawChosen(view.chosen, 2.2);
  drawChosen(view.under, 1.5);
  taken = [[0, view.height - 58, 170, view.height], [0, view.height - 20, view.width, view.height], [view.width - 34, 0, view.width, 46]];
  taken.push(...ticksY().map(([py, text]) => [0, py - 8, 8 + 7 * text.length, py + 8]));
  markers(bounds);
  junctionLabels(bounds);
  roadLabels(bounds);
  const top = [...shown].sort((a, b) => (a.road.junction === null ? 0 : 1) - (b.road.junction === null ? 0 : 1));
  laneLabels(top);
  arrows(top);
  drawAxes();
  drawRuler();
  scaleBar();
  north();
}
