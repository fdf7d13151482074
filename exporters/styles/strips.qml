<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: from the first strip (orange) over green to the last (blue). -->
<qgis version="3.34.0" styleCategories="Symbology|Labeling|MapTips|Temporal|Rendering">
 <temporal enabled="1" mode="1" startField="start" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="120,198,121,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="70,70,70,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="ramp_color(create_ramp(map(0, '#fdd49e', 0.5, '#78c679', 1, '#225ea8')), if(maximum(&quot;strip&quot;) &gt; 1, (&quot;strip&quot; - 1) / (maximum(&quot;strip&quot;) - 1), 0.5))"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="strip" fontSize="10" fontSizeUnit="Point" fontFamily="Sans" textColor="40,40,40,255" isExpression="0">
    <text-buffer bufferDraw="1" bufferSize="1" bufferSizeUnits="MM" bufferColor="255,255,255,220"/>
   </text-style>
  </settings>
 </labeling>
 <layerOpacity>0.5</layerOpacity>
 <mapTip enabled="1">&lt;b&gt;strip [% "strip" %]&lt;/b&gt;, [% format_date("start", 'HH:mm:ss') %] to [% format_date("end", 'HH:mm:ss') %] UTC&lt;br&gt;[% format_number("length_m", 1) %] m towards [% format_number("heading_deg", 0) %]° at [% format_number(3.6 * "speed_mps", 1) %] km/h, [% format_number("points_m2", 0) %] points a square metre</mapTip>
</qgis>
