const osc = require('osc');
const packets = JSON.parse(require('fs').readFileSync(0, 'utf8')).map(([address, args]) => ({ address, args }));
console.log(Buffer.from(osc.writePacket({ timeTag: { raw: [0, 1] }, packets })).toString('hex'));
